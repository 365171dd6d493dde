// @ts-check
// What is seen in the plots, as a table or a picture.

import { colors } from '../shared/theme.js';

/**
 * @param {{key: string, label: string, unit: string}[]} quantities
 * @param {number[]} times  steady clock, seconds
 * @param {(number | null)[][]} columns
 * @param {(steadyS: number) => number} unixAt
 * @returns {string} unknown values are empty fields
 */
export function csvOfSpan(quantities, times, columns, unixAt) {
  const name = (/** @type {{key: string, unit: string}} */ q) => `${q.key} [${q.unit}]`;
  const lines = [['time_utc', 'unix_s', ...quantities.map(name)].join(',')];
  times.forEach((time, row) => {
    if (columns.every((column) => column[row] === null)) return;
    const unix = unixAt(time);
    const cells = columns.map((column) => (column[row] === null ? '' : String(column[row])));
    lines.push([new Date(unix * 1000).toISOString(), unix.toFixed(3), ...cells].join(','));
  });
  return `${lines.join('\r\n')}\r\n`;
}

/**
 * A time as part of a file name, in UTC: "20261122-084631".
 * @param {number} unixS
 */
export function fileStamp(unixS) {
  return new Date(unixS * 1000).toISOString().slice(0, 19).replaceAll(/[-:]/g, '').replace('T', '-');
}

/**
 * @param {import('uplot')[]} plots
 * @param {string[]} titles
 * @param {string} heading
 * @returns {Promise<Blob | null>}
 */
export function pngOfPlots(plots, titles, heading) {
  const ratio = window.devicePixelRatio || 1;
  const line = Math.round(22 * ratio);
  const canvases = plots.map((plot) => plot.ctx.canvas);
  const sheet = document.createElement('canvas');
  sheet.width = Math.max(1, ...canvases.map((canvas) => canvas.width));
  sheet.height = line * 1.5 + canvases.reduce((sum, canvas) => sum + canvas.height + line, 0);
  const context = sheet.getContext('2d');
  if (!context) return Promise.resolve(null);
  const [background, text, dim] = colors('--surface', '--text', '--dim');
  context.fillStyle = background;
  context.fillRect(0, 0, sheet.width, sheet.height);
  context.fillStyle = text;
  context.font = `600 ${Math.round(14 * ratio)}px system-ui, sans-serif`;
  context.textBaseline = 'middle';
  context.fillText(heading, 8 * ratio, line * 0.75);
  context.font = `${Math.round(12 * ratio)}px system-ui, sans-serif`;
  context.fillStyle = dim;
  let y = line * 1.5;
  canvases.forEach((canvas, i) => {
    context.fillText(titles[i], 8 * ratio, y + line / 2);
    context.drawImage(canvas, 0, y + line);
    y += line + canvas.height;
  });
  return new Promise((resolve) => sheet.toBlob(resolve, 'image/png'));
}
