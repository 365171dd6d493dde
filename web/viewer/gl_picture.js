// @ts-check
/**
 * The picture by WebGL2: one texture row per ping, levels, time-varied gain, palette and mirroring in the fragment
 * shader, so that a change of gain shows in the past as well and a new ping costs one row of upload.
 *
 * The shader paints into a texture that is a ring in time: row r of the time grid lies at r modulo the pane's height.
 * A picture that moved on costs its new rows and one copy, which software rendering at 4K can follow, too.
 */

/** @typedef {import('./ping_ring.js').PingRing} PingRing */
/** @typedef {import('./ranging.js').Pane} Pane */
/** @typedef {import('./picture_state.js').PictureState} PictureState */

import { TVG_BINS, ratioFromDb } from './gain.js';
import { HATCH_PX, PictureChanges } from './picture_changes.js';
import { MOST_PINGS_IN_A_ROW } from './row_table.js';

const VERTEX = `#version 300 es
void main() {
  gl_Position = vec4(vec2((gl_VertexID << 1) & 2, gl_VertexID & 2) * 2.0 - 1.0, 0.0, 1.0);
}`;

// A texel of 0 in u_samples marks a missing sample; amplitudes 0..255 are stored as 1..255.
const FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
precision highp isampler2D;
precision highp sampler2DArray;
uniform sampler2DArray u_samples;  // x sample, y slot, layer ring
uniform sampler2D u_pings;         // x slot, y layer: first sample, resolution, count
uniform isampler2D u_rows;         // x row of the picture, y channel: code, pings
uniform sampler2D u_tvg;           // x range bin, y channel
uniform sampler2D u_palette;
uniform vec4 u_pane;               // x, y from below, width, height
uniform ivec3 u_top;               // top row modulo height, its phase in the hatching, period of the hatching
uniform int u_channel;
uniform int u_capacity;
uniform bool u_mirrored;
uniform vec2 u_range;
uniform vec4 u_levels;             // black, gain / (white - black), gamma, range of the last tvg bin
uniform vec3 u_nothing;
uniform vec3 u_hatch;
out vec4 color;

const int MOST_SAMPLES = 16;

vec3 hatched(int x, int row) {
  return (x + row + u_top.y) % u_top.z < max(u_top.z / 4, 1) ? u_hatch : u_nothing;
}

float tvg(float range) {
  float at = clamp(range / u_levels.w * ${TVG_BINS}.0 - 0.5, 0.0, ${TVG_BINS - 1}.0);
  int bin = min(int(at), ${TVG_BINS - 2});
  float lower = texelFetch(u_tvg, ivec2(bin, u_channel), 0).r;
  return mix(lower, texelFetch(u_tvg, ivec2(bin + 1, u_channel), 0).r, at - float(bin));
}

void main() {
  vec2 at = gl_FragCoord.xy - u_pane.xy;
  int row = u_top.x - int(at.y);
  if (row < 0) row += int(u_pane.w);
  ivec2 code = texelFetch(u_rows, ivec2(row, u_channel), 0).xy;
  if (code.x < 0) {
    color = vec4(code.x == -1 ? u_nothing : hatched(int(gl_FragCoord.x), row), 1.0);
    return;
  }
  float across = at.x / u_pane.z;
  float range = mix(u_range.x, u_range.y, u_mirrored ? 1.0 - across : across);
  float halfPixel = 0.5 * (u_range.y - u_range.x) / u_pane.z;
  int layer = code.x / u_capacity;
  int first = code.x - layer * u_capacity;
  float sum = 0.0;
  float found = 0.0;
  bool inside = false;
  for (int k = 0; k < ${MOST_PINGS_IN_A_ROW}; k++) {
    if (k >= code.y) break;
    int slot = (first + k) % u_capacity;
    vec4 ping = texelFetch(u_pings, ivec2(slot, layer), 0);
    float middle = range / ping.y - ping.x + 0.5;
    float reach = halfPixel / ping.y;
    int last = int(ping.z) - 1;
    int from = max(int(floor(middle - reach)), 0);
    int to = min(max(int(ceil(middle + reach)) - 1, int(floor(middle))), last);
    if (middle < 0.0 || from > last) continue;
    inside = true;
    int step = 1 + (to - from) / MOST_SAMPLES;
    for (int j = 0; j < MOST_SAMPLES; j++) {
      int i = from + j * step;
      if (i > to) break;
      float value = texelFetch(u_samples, ivec3(i, slot, layer), 0).r;
      if (value > 0.0) {
        sum += value;
        found += 1.0;
      }
    }
  }
  if (found == 0.0) {
    color = vec4(inside ? hatched(int(gl_FragCoord.x), row) : u_nothing, 1.0);
    return;
  }
  float amplitude = (sum / found * 255.0 - 1.0) / 254.0;
  float level = clamp((amplitude * tvg(range) - u_levels.x) * u_levels.y, 0.0, 1.0);
  color = vec4(texelFetch(u_palette, ivec2(int(pow(level, u_levels.z) * 255.0 + 0.5), 0), 0).rgb, 1.0);
}`;

const UNIFORMS = /** @type {const} */ ([
  'u_samples',
  'u_pings',
  'u_rows',
  'u_tvg',
  'u_palette',
  'u_pane',
  'u_channel',
  'u_capacity',
  'u_mirrored',
  'u_range',
  'u_levels',
  'u_nothing',
  'u_hatch',
  'u_top',
]);

/** How an amplitude is stored in the texture: never 0. */
const STORED = Uint8Array.from({ length: 256 }, (_, amplitude) => 1 + Math.round((amplitude * 254) / 255));

/** Texture units. */
const SAMPLES = 0;
const PINGS = 1;
const ROWS = 2;
const TVG = 3;
const PALETTE = 4;
const PAINTED = 5;

export class GlPicture {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {PingRing[]} rings by layer
   * @param {() => void} onRestored the context came back: draw again
   * @returns {GlPicture | null} null where WebGL2 is missing
   */
  static create(canvas, rings, onRestored) {
    const gl = canvas.getContext('webgl2', { alpha: false, antialias: false, powerPreference: 'low-power' });
    if (!gl || gl.getParameter(gl.MAX_TEXTURE_SIZE) < rings[0].capacity) return null;
    return new GlPicture(canvas, gl, rings, onRestored);
  }

  /**
   * @param {HTMLCanvasElement} canvas
   * @param {WebGL2RenderingContext} gl
   * @param {PingRing[]} rings
   * @param {() => void} onRestored
   */
  constructor(canvas, gl, rings, onRestored) {
    this.kind = 'WebGL2';
    this.canvas = canvas;
    this.gl = gl;
    this.rings = rings;
    this.capacity = rings[0].capacity;
    this.width = 0;
    this.pingValues = new Float32Array(4);
    this.rowsHeight = 0;
    this.changes = new PictureChanges();
    this.paintedWidth = 0;
    this.paintedHeight = 0;
    this.hatchPeriod = HATCH_PX;
    /** @type {Record<typeof UNIFORMS[number], WebGLUniformLocation | null>} */
    this.at = Object.create(null);
    this.prepare();
    rings.forEach((ring, layer) => {
      ring.onWrite = (slot) => this.upload(layer, slot);
    });
    canvas.addEventListener('webglcontextlost', (event) => event.preventDefault());
    canvas.addEventListener('webglcontextrestored', () => {
      this.prepare();
      this.uploadAll();
      onRestored();
    });
  }

  prepare() {
    const gl = this.gl;
    const program = link(gl);
    gl.useProgram(program);
    gl.bindVertexArray(gl.createVertexArray());
    for (const name of UNIFORMS) this.at[name] = gl.getUniformLocation(program, name);
    const units = [SAMPLES, PINGS, ROWS, TVG, PALETTE, PAINTED];
    this.textures = units.map((unit) => {
      const texture = gl.createTexture();
      const target = unit === SAMPLES ? gl.TEXTURE_2D_ARRAY : gl.TEXTURE_2D;
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(target, texture);
      for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
        gl.texParameteri(target, filter, gl.NEAREST);
      }
      return texture;
    });
    gl.uniform1i(this.at.u_samples, SAMPLES);
    gl.uniform1i(this.at.u_pings, PINGS);
    gl.uniform1i(this.at.u_rows, ROWS);
    gl.uniform1i(this.at.u_tvg, TVG);
    gl.uniform1i(this.at.u_palette, PALETTE);
    gl.uniform1i(this.at.u_capacity, this.capacity);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.activeTexture(gl.TEXTURE0 + PINGS);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, this.capacity, this.rings.length);
    gl.activeTexture(gl.TEXTURE0 + TVG);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.R32F, TVG_BINS, 2);
    gl.activeTexture(gl.TEXTURE0 + PALETTE);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, 256, 1);
    this.framebuffer = gl.createFramebuffer();
    this.paintedWidth = 0;
    this.paintedHeight = 0;
    this.rowsHeight = 0;
    this.width = 0;
    this.changes.everything();
    this.makeSampleTexture();
  }

  /** The texture that is painted on, as large as the canvas. */
  makePaintedTexture() {
    const gl = this.gl;
    const { width, height } = this.canvas;
    if (width === this.paintedWidth && height === this.paintedHeight) return;
    this.paintedWidth = width;
    this.paintedHeight = height;
    gl.activeTexture(gl.TEXTURE0 + PAINTED);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer ?? null);
    const painted = this.textures?.[PAINTED] ?? null;
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, painted, 0);
    this.changes.everything();
  }

  /** As wide as the widest ring; rings that grow later bring us here again. */
  makeSampleTexture() {
    const gl = this.gl;
    const width = Math.max(...this.rings.map((ring) => ring.width));
    if (width === this.width) return;
    this.width = width;
    this.scratch = new Uint8Array(width);
    gl.activeTexture(gl.TEXTURE0 + SAMPLES);
    gl.texImage3D(
      gl.TEXTURE_2D_ARRAY,
      0,
      gl.R8,
      width,
      this.capacity,
      this.rings.length,
      0,
      gl.RED,
      gl.UNSIGNED_BYTE,
      null,
    );
  }

  uploadAll() {
    this.makeSampleTexture();
    this.rings.forEach((ring, layer) => {
      for (let index = 0; index < ring.length; index++) this.upload(layer, ring.slot(index));
    });
  }

  /**
   * @param {number} layer
   * @param {number} slot -1 when the ring's memory was made anew
   */
  upload(layer, slot) {
    if (slot < 0) {
      this.uploadAll();
      return;
    }
    const gl = this.gl;
    const ring = this.rings[layer];
    const scratch = /** @type {Uint8Array} */ (this.scratch);
    const count = ring.count[slot];
    const start = slot * ring.width;
    for (let i = 0; i < count; i++) scratch[i] = STORED[ring.samples[start + i]];
    const gaps = ring.gaps[slot];
    for (let k = 0; k < gaps.length; k += 2) scratch.fill(0, gaps[k], gaps[k + 1]);
    gl.activeTexture(gl.TEXTURE0 + SAMPLES);
    if (count > 0) {
      gl.texSubImage3D(
        gl.TEXTURE_2D_ARRAY,
        0,
        0,
        slot,
        layer,
        count,
        1,
        1,
        gl.RED,
        gl.UNSIGNED_BYTE,
        scratch,
      );
    }
    this.pingValues[0] = ring.firstSample[slot];
    this.pingValues[1] = ring.resolutionM[slot];
    this.pingValues[2] = count;
    gl.activeTexture(gl.TEXTURE0 + PINGS);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, slot, layer, 1, 1, gl.RGBA, gl.FLOAT, this.pingValues);
  }

  /** @param {Uint8Array} table 256 x RGBA */
  setPalette(table) {
    const gl = this.gl;
    this.changes.everything();
    gl.activeTexture(gl.TEXTURE0 + PALETTE);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, 256, 1, gl.RGBA, gl.UNSIGNED_BYTE, table);
  }

  /** @param {number} channel @param {Float32Array} table */
  setTvg(channel, table) {
    const gl = this.gl;
    this.changes.everything();
    gl.activeTexture(gl.TEXTURE0 + TVG);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, channel, TVG_BINS, 1, gl.RED, gl.FLOAT, table);
  }

  /**
   * @param {Pane[]} panes
   * @param {Int16Array[]} rowTables by channel
   * @param {number} topRow on the time grid
   * @param {PictureState} state
   */
  draw(panes, rowTables, topRow, state) {
    const gl = this.gl;
    if (gl.isContextLost()) return;
    this.makePaintedTexture();
    this.uploadRows(rowTables, panes);
    this.setState(state);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer ?? null);
    gl.enable(gl.SCISSOR_TEST);
    this.changes.begin(panes, state, this.rings);
    for (let k = 0; k < panes.length; k++) this.paintPane(panes[k], rowTables, topRow);
    this.changes.end(rowTables, topRow);
    gl.disable(gl.SCISSOR_TEST);
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, this.framebuffer ?? null);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    // The browser owes the canvas a clearing after it was shown, and a copy alone does not call that in: it would come
    // later, over the copy, when the picture is read for a snapshot.
    gl.clear(gl.COLOR_BUFFER_BIT);
    for (let k = 0; k < panes.length; k++) this.copyPane(panes[k], topRow);
  }

  /** @param {PictureState} state */
  setState(state) {
    const gl = this.gl;
    const { gain } = state;
    gl.uniform2f(this.at.u_range, state.fromM, state.toM);
    const slope = ratioFromDb(gain.gainDb) / Math.max(gain.white - gain.black, 1e-3);
    gl.uniform4f(this.at.u_levels, gain.black, slope, gain.gamma, state.tvgMaximumM);
    gl.uniform3fv(this.at.u_nothing, state.nothingRgb);
    gl.uniform3fv(this.at.u_hatch, state.hatchRgb);
    this.hatchPeriod = Math.max(4, Math.round(HATCH_PX * state.dpr));
  }

  /** @param {Pane} pane from below @returns {number} */
  bottomOf(pane) {
    return this.canvas.height - pane.y - pane.height;
  }

  /** @param {Pane} pane @param {Int16Array[]} rowTables @param {number} topRow */
  paintPane(pane, rowTables, topRow) {
    const gl = this.gl;
    const bottom = this.bottomOf(pane);
    const channel = pane.channel === 'A' ? 0 : 1;
    const period = this.hatchPeriod;
    const top = modulo(topRow, pane.height);
    gl.viewport(pane.x, bottom, pane.width, pane.height);
    gl.uniform4f(this.at.u_pane, pane.x, bottom, pane.width, pane.height);
    // Rows count downwards, time upwards: the hatching belongs to the time and moves with it.
    gl.uniform3i(this.at.u_top, top, modulo(-topRow, period), period);
    gl.uniform1i(this.at.u_channel, channel);
    gl.uniform1i(this.at.u_mirrored, pane.mirrored ? 1 : 0);
    this.changes.each(channel, rowTables[channel], topRow, pane.height, (from, to) => {
      // Rows from..to-1 lie at top-from down to top-to+1 of the ring, in one piece or two.
      const high = top - from;
      const low = top - to + 1;
      if (high >= 0) this.paintRows(pane, bottom, Math.max(0, low), high);
      if (low < 0) this.paintRows(pane, bottom, low + pane.height, Math.min(high, -1) + pane.height);
    });
  }

  /** @param {Pane} pane @param {number} bottom @param {number} low @param {number} high rows of the ring, inclusive */
  paintRows(pane, bottom, low, high) {
    const gl = this.gl;
    gl.scissor(pane.x, bottom + low, pane.width, high - low + 1);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** From the ring to the screen, the newest row on top. @param {Pane} pane @param {number} topRow */
  copyPane(pane, topRow) {
    const { x, width, height } = pane;
    const bottom = this.bottomOf(pane);
    const upper = modulo(topRow, height) + 1;
    this.copyRows(x, width, bottom, upper, bottom + height - upper);
    this.copyRows(x, width, bottom + upper, height - upper, bottom);
  }

  /** @param {number} x @param {number} width @param {number} from @param {number} rows @param {number} to */
  copyRows(x, width, from, rows, to) {
    const gl = this.gl;
    if (rows <= 0) return;
    gl.blitFramebuffer(
      x,
      from,
      x + width,
      from + rows,
      x,
      to,
      x + width,
      to + rows,
      gl.COLOR_BUFFER_BIT,
      gl.NEAREST,
    );
  }

  /** @param {Int16Array[]} rowTables @param {Pane[]} panes */
  uploadRows(rowTables, panes) {
    const gl = this.gl;
    const rows = rowTables[0].length / 2;
    gl.activeTexture(gl.TEXTURE0 + ROWS);
    if (rows !== this.rowsHeight) {
      this.rowsHeight = rows;
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RG16I, rows, 2, 0, gl.RG_INTEGER, gl.SHORT, null);
    }
    for (let k = 0; k < panes.length; k++) {
      const channel = panes[k].channel === 'A' ? 0 : 1;
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, channel, rows, 1, gl.RG_INTEGER, gl.SHORT, rowTables[channel]);
    }
  }
}

/** @param {number} value @param {number} by */
function modulo(value, by) {
  return ((value % by) + by) % by;
}

/** @param {WebGL2RenderingContext} gl */
function link(gl) {
  const program = gl.createProgram();
  gl.attachShader(program, compile(gl, gl.VERTEX_SHADER, VERTEX));
  gl.attachShader(program, compile(gl, gl.FRAGMENT_SHADER, FRAGMENT));
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    throw new Error(`shader program: ${gl.getProgramInfoLog(program)}`);
  }
  return program;
}

/** @param {WebGL2RenderingContext} gl @param {number} type @param {string} source */
function compile(gl, type, source) {
  const shader = /** @type {WebGLShader} */ (gl.createShader(type));
  gl.shaderSource(shader, source);
  gl.compileShader(shader);
  if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
    throw new Error(`shader: ${gl.getShaderInfoLog(shader)}`);
  }
  return shader;
}
