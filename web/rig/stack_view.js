// @ts-check
// The stack in three dimensions. Rig frame as everywhere: x forward, y right, z down, mm.

import { colors } from '../shared/theme.js';

/** @typedef {import('./three.js').Three} Three */
/** @typedef {[number, number, number]} Place */
/**
 * @typedef {object} StackLines
 * @property {Place[][]} base_mm  servo axes of each platform
 * @property {(number | null)[][][]} arm_ends_mm  null where a leg does not reach
 * @property {Place[][]} plate_mm
 * @property {Place} tool_mm
 * @property {number[][]} tool_rotation
 * @property {number[][] | null} covariance_mm2  of the tool's place
 */

// Half the side of the square of the thesis's receivers, in the plane across the array's x.
const RECEIVER_MM = 176.8;
// A Gaussian in three dimensions lies within so many standard deviations with 95 %.
const SIGMAS_95 = 2.796;
const MIDDLE = /** @type {Place} */ ([60, 0, -400]);

/**
 * Eigenvalues and vectors of a symmetric 3 x 3 matrix, by Jacobi rotations.
 * @param {number[][]} matrix
 * @returns {{values: Place, vectors: number[][]}} vectors in columns
 */
export function principalAxes(matrix) {
  const a = matrix.map((row) => [...row]);
  const v = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ];
  for (let sweep = 0; sweep < 20; sweep += 1) {
    for (const [p, q] of [
      [0, 1],
      [0, 2],
      [1, 2],
    ]) {
      if (Math.abs(a[p][q]) < 1e-12) continue;
      const angle = 0.5 * Math.atan2(2 * a[p][q], a[q][q] - a[p][p]);
      const [c, s] = [Math.cos(angle), Math.sin(angle)];
      for (let k = 0; k < 3; k += 1)
        [a[k][p], a[k][q]] = [c * a[k][p] - s * a[k][q], s * a[k][p] + c * a[k][q]];
      for (let k = 0; k < 3; k += 1)
        [a[p][k], a[q][k]] = [c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]];
      for (let k = 0; k < 3; k += 1)
        [v[k][p], v[k][q]] = [c * v[k][p] - s * v[k][q], s * v[k][p] + c * v[k][q]];
    }
  }
  return { values: [a[0][0], a[1][1], a[2][2]], vectors: v };
}

export class StackView {
  /**
   * @param {Three} three
   * @param {HTMLCanvasElement} canvas
   */
  constructor(three, canvas) {
    this.three = three;
    this.canvas = canvas;
    this.renderer = new three.WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.scene = new three.Scene();
    this.camera = new three.PerspectiveCamera(40, 1, 10, 8000);
    this.camera.up.set(0, 0, -1);
    this.camera.position.set(1200, 1050, -860);
    this.controls = new three.OrbitControls(this.camera, canvas);
    this.controls.target.set(...MIDDLE);
    this.controls.update();
    this.controls.addEventListener('change', () => this.draw());
    this.scene.add(new three.AmbientLight(0xffffff, 1.6));
    const lamp = new three.DirectionalLight(0xffffff, 2.2);
    lamp.position.set(600, 900, -1500);
    this.scene.add(lamp);
    this.rods = new three.Group();
    this.scene.add(this.rods);
    this.cylinder = new three.CylinderGeometry(1, 1, 1, 12);
    this.sphere = new three.SphereGeometry(1, 32, 20);
    /** @type {StackLines | null} */
    this.lines = null;
    this.update = () => this.resize();
    new ResizeObserver(this.update).observe(canvas);
    this.paint();
  }

  /** Takes the colours of the theme. */
  paint() {
    const names = ['--warn', '--accent', '--line-strong', '--ok', '--plot-sound', '--fault', '--line'];
    const [arm, rod, plate, array, ellipse, fault, grid] = colors(...names);
    const { three } = this;
    /** @param {string} color */
    const solid = (color) =>
      new three.MeshLambertMaterial({ color: new three.Color(color), side: three.DoubleSide });
    this.paints = {
      arm: solid(arm),
      rod: solid(rod),
      plate: solid(plate),
      array: solid(array),
      fault: solid(fault),
      ellipse: new three.MeshBasicMaterial({
        color: new three.Color(ellipse),
        transparent: true,
        opacity: 0.45,
      }),
    };
    if (this.grid) this.scene.remove(this.grid);
    this.grid = new three.GridHelper(1200, 12, new three.Color(grid), new three.Color(grid));
    this.grid.rotation.x = Math.PI / 2;
    this.scene.add(this.grid);
    this.show(this.lines);
  }

  resize() {
    const { clientWidth, clientHeight } = this.canvas;
    if (!clientWidth || !clientHeight) return;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  draw() {
    this.renderer.render(this.scene, this.camera);
  }

  /** @param {StackLines | null} lines */
  show(lines) {
    this.lines = lines;
    for (const child of this.rods.children) {
      const mesh = /** @type {import('../../scripts/three.mjs').Mesh} */ (child);
      if (mesh.geometry !== this.cylinder && mesh.geometry !== this.sphere) mesh.geometry.dispose();
    }
    this.rods.clear();
    if (lines) this.build(lines);
    this.draw();
  }

  /** @param {StackLines} lines */
  build(lines) {
    const { paints, three } = this;
    if (!paints) return;
    lines.base_mm.forEach((base, platform) => {
      this.ring(base, paints.plate);
      this.ring(lines.plate_mm[platform], paints.plate);
      base.forEach((joint, leg) => {
        const end = lines.arm_ends_mm[platform][leg];
        const top = lines.plate_mm[platform][leg];
        if (end.some((value) => value === null)) {
          this.bar(joint, top, 2, paints.fault);
          return;
        }
        const elbow = /** @type {Place} */ (end);
        this.bar(joint, elbow, 4, paints.arm);
        this.bar(elbow, top, 2, paints.rod);
      });
    });
    const top = lines.plate_mm[lines.plate_mm.length - 1];
    const centre = /** @type {Place} */ (
      [0, 1, 2].map((k) => top.reduce((sum, joint) => sum + joint[k], 0) / 6)
    );
    this.bar(centre, lines.tool_mm, 4, paints.array);
    for (const side of [1, -1]) {
      this.bar(
        this.inTool(lines, [0, -RECEIVER_MM, -side * RECEIVER_MM]),
        this.inTool(lines, [0, RECEIVER_MM, side * RECEIVER_MM]),
        4,
        paints.array,
      );
    }
    if (lines.covariance_mm2) {
      const { values, vectors } = principalAxes(lines.covariance_mm2);
      const ellipsoid = new three.Mesh(this.sphere, paints.ellipse);
      const [x, y, z] = [0, 1, 2].map((k) => {
        const length = SIGMAS_95 * Math.sqrt(Math.max(values[k], 0));
        return new three.Vector3(...vectors.map((row) => row[k] * length));
      });
      ellipsoid.matrixAutoUpdate = false;
      ellipsoid.matrix.makeBasis(x, y, z).setPosition(...lines.tool_mm);
      this.rods.add(ellipsoid);
    }
  }

  /**
   * @param {StackLines} lines
   * @param {Place} place
   * @returns {Place}
   */
  inTool(lines, place) {
    return /** @type {Place} */ (
      lines.tool_rotation.map(
        (row, k) => lines.tool_mm[k] + row.reduce((sum, value, j) => sum + value * place[j], 0),
      )
    );
  }

  /**
   * @param {Place[]} joints
   * @param {any} paint
   */
  ring(joints, paint) {
    const { three } = this;
    const centre = [0, 1, 2].map((k) => joints.reduce((sum, joint) => sum + joint[k], 0) / joints.length);
    const angle = (/** @type {Place} */ joint) => Math.atan2(joint[1] - centre[1], joint[0] - centre[0]);
    const around = [...joints].sort((a, b) => angle(a) - angle(b));
    const corners = around.flatMap((joint, k) => [...centre, ...joint, ...around[(k + 1) % around.length]]);
    const geometry = new three.BufferGeometry();
    geometry.setAttribute('position', new three.Float32BufferAttribute(corners, 3));
    geometry.computeVertexNormals();
    this.rods.add(new three.Mesh(geometry, paint));
  }

  /**
   * @param {Place} from
   * @param {Place} to
   * @param {number} radius
   * @param {any} paint
   */
  bar(from, to, radius, paint) {
    const { three } = this;
    const [start, end] = [new three.Vector3(...from), new three.Vector3(...to)];
    const mesh = new three.Mesh(this.cylinder, paint);
    mesh.position.copy(start).add(end).multiplyScalar(0.5);
    mesh.scale.set(radius, start.distanceTo(end), radius);
    mesh.quaternion.setFromUnitVectors(new three.Vector3(0, 1, 0), end.sub(start).normalize());
    this.rods.add(mesh);
  }
}
