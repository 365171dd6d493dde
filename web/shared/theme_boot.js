// A classic script for <head>: sets the theme before the first paint, so that a night bridge sees no white flash.
// Order: ?theme= in the address, what the switch stored, what the system prefers. theme.js takes over from here.
(() => {
  const wanted = new URLSearchParams(location.search).get('theme');
  let stored = null;
  try {
    stored = localStorage.getItem('bluerov-slam.theme');
  } catch {
    // A sandboxed iframe has no storage: the system's preference it is.
  }
  const choice = [wanted, stored].find((theme) => theme === 'light' || theme === 'dark');
  const system = matchMedia('(prefers-color-scheme: light)').matches ? 'light' : 'dark';
  document.documentElement.dataset.theme = choice ?? system;
})();
