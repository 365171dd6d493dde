// @ts-check
/** Line icons of the tool bar, 24 x 24. */

/** @type {Record<string, string>} */
const PATHS = {
  pause: 'M8 5v14M16 5v14',
  play: 'M7 4l13 8-13 8z',
  picture: 'M4 12h3m4 0h9M4 6h9m4 0h3M4 18h6m4 0h6M9 9.5v5M15 3.5v5M12 15.5v5',
  contacts: 'M12 3l8 9-8 9-8-9zM12 9v6M9 12h6',
  sonar: 'M12 20l-7-12M12 20l7-12M7.5 12.5a8 8 0 0 0 9 0M5 8a13 13 0 0 0 14 0M12 20v.01',
  measure: 'M3 16L16 3l5 5L8 21zM7 12l2 2M10 9l3 3M13 6l2 2',
  snapshot: 'M4 8h3l2-3h6l2 3h3v11H4zM12 10a3.5 3.5 0 1 0 0 7 3.5 3.5 0 0 0 0-7',
  layout: 'M3 5h18v14H3zM12 5v14',
  full: 'M4 9V4h5M20 9V4h-5M4 15v5h5M20 15v5h-5',
  theme: 'M12 4a8 8 0 1 0 0 16 8 8 0 1 0 0-16M12 4v16M12 8h4.8M12 12h8M12 16h6',
  sensors: 'M4 17a8 8 0 1 1 16 0M12 17l4-6M12 17v.01M7 13v.01M9.5 11v.01',
  help: 'M9 9a3 3 0 1 1 4.5 2.6c-1 .6-1.5 1.2-1.5 2.4M12 17.5v.01M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18',
};

/** @param {string} name */
export function icon(name) {
  const svg = document.createElementNS('http://www.w3.org/2000/svg', 'svg');
  svg.setAttribute('viewBox', '0 0 24 24');
  svg.setAttribute('class', 'icon');
  svg.setAttribute('aria-hidden', 'true');
  const path = document.createElementNS('http://www.w3.org/2000/svg', 'path');
  path.setAttribute('d', PATHS[name] ?? '');
  svg.append(path);
  return svg;
}

/** @param {SVGElement} svg @param {string} name */
export function setIcon(svg, name) {
  const path = svg.firstElementChild;
  if (path && path.getAttribute('d') !== PATHS[name]) path.setAttribute('d', PATHS[name]);
}
