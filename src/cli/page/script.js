'use strict';
(() => {
  const root = document.documentElement, own = document.currentScript.dataset;
  const MOST = 32, STEP = 1.5, KEY = 'bdpm ' + location.pathname;
  const state = { zoom: 1, x: 0, y: 0, split: 50, scroll: 0, open: [], focus: null };
  root.classList.add('js');

  // What was seen before the page loaded itself again. Browsers may forbid to keep it.
  const store = write => { try { return write(sessionStorage); } catch { return null; } };
  const kept = store(storage => JSON.parse(storage.getItem(KEY)));
  if (kept) Object.assign(state, kept);

  const find = id => document.getElementById(id);
  const frames = [...document.querySelectorAll('.frame')];
  // Names to come back to.
  frames.forEach((frame, i) => { frame.id ||= 'frame-' + i; });
  const split = find('split'), scale = find('scale');

  /** Shows the state: x and y are where the picture's corner is, in percent of the frame. */
  const show = () => {
    state.zoom = Math.min(MOST, Math.max(1, state.zoom));
    const least = 100 * (1 - state.zoom);
    for (const axis of ['x', 'y']) state[axis] = Math.min(0, Math.max(least, state[axis]));
    for (const name of ['zoom', 'x', 'y', 'split']) root.style.setProperty('--' + name, state[name]);
    root.classList.toggle('zoomed', state.zoom > 1);
    if (scale) scale.value = Math.round(100 * state.zoom) + ' %';
    if (split) split.value = state.split;
  };
  /** Magnifies by a factor; the place at (x, y), percent of the frame, stays. */
  const magnify = (factor, x = 50, y = 50) => {
    const before = state.zoom;
    state.zoom = Math.min(MOST, Math.max(1, before * factor));
    const ratio = state.zoom / before;
    state.x = x - ratio * (x - state.x);
    state.y = y - ratio * (y - state.y);
    show();
  };
  const move = (x, y) => { state.x += x; state.y += y; show(); };
  const whole = () => { state.zoom = 1; state.x = state.y = 0; show(); };

  find('in')?.addEventListener('click', () => magnify(STEP));
  find('out')?.addEventListener('click', () => magnify(1 / STEP));
  find('fit')?.addEventListener('click', whole);
  split?.addEventListener('input', () => { state.split = +split.value; show(); });

  const keys = {
    '+': () => magnify(STEP), '=': () => magnify(STEP), '-': () => magnify(1 / STEP), '0': whole,
    ArrowLeft: () => move(10, 0), ArrowRight: () => move(-10, 0),
    ArrowUp: () => move(0, 10), ArrowDown: () => move(0, -10),
  };
  for (const frame of frames) {
    const fingers = new Map();
    const place = event => {
      const box = frame.getBoundingClientRect();
      return [100 * (event.clientX - box.left) / box.width, 100 * (event.clientY - box.top) / box.height];
    };
    frame.addEventListener('keydown', event => {
      if (event.ctrlKey || event.metaKey || event.altKey || !keys[event.key]) return;
      if (event.key.startsWith('Arrow') && state.zoom === 1) return;
      event.preventDefault();
      keys[event.key]();
    });
    frame.addEventListener('wheel', event => {
      if (!event.ctrlKey && !event.metaKey) return;
      event.preventDefault();
      magnify(Math.exp(-0.004 * event.deltaY), ...place(event));
    }, { passive: false });
    frame.addEventListener('dblclick', event => magnify(2, ...place(event)));
    frame.addEventListener('pointerdown', event => {
      fingers.set(event.pointerId, place(event));
      if (state.zoom > 1) frame.setPointerCapture(event.pointerId);
    });
    frame.addEventListener('pointermove', event => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const now = place(event), other = [...fingers].find(([id]) => id !== event.pointerId)?.[1];
      fingers.set(event.pointerId, now);
      if (other) {
        const far = point => Math.hypot(point[0] - other[0], point[1] - other[1]);
        magnify(far(now) / Math.max(1, far(before)), ...other);
      } else if (state.zoom > 1) {
        move(now[0] - before[0], now[1] - before[1]);
      }
    });
    for (const end of ['pointerup', 'pointercancel', 'pointerleave']) {
      frame.addEventListener(end, event => fingers.delete(event.pointerId));
    }
  }

  for (const time of document.querySelectorAll('time[data-time]')) {
    time.textContent = 'on ' + new Date(+time.dataset.time).toLocaleString();
  }

  // Nothing new for long?
  const silent = (Date.now() - own.time) / 1000, isStale = own.reload && silent > 5 * own.reload + 60;
  if (isStale) {
    const note = document.createElement('p');
    note.className = 'stale';
    note.textContent = 'Nothing new since ' + new Date(+own.time).toLocaleString() +
      ': an iteration may take long, or the program was ended.';
    document.querySelector('main').prepend(note);
  }

  // Again what it was before.
  for (const id of state.open) find(id)?.setAttribute('open', '');
  show();
  if (kept) {
    history.scrollRestoration = 'manual';
    scrollTo(0, state.scroll);
    if (state.focus) find(state.focus)?.focus({ preventScroll: true });
  }
  const keep = () => {
    state.scroll = scrollY;
    state.open = [...document.querySelectorAll('details[open]')].map(details => details.id);
    state.focus = document.activeElement?.id || null;
    store(storage => storage.setItem(KEY, JSON.stringify(state)));
  };
  addEventListener('pagehide', keep);

  // While rendering goes on, there will be a newer page.
  if (own.reload) {
    let held = false;
    addEventListener('pointerdown', () => { held = true; });
    addEventListener('pointerup', () => { held = false; });
    addEventListener('pointercancel', () => { held = false; });
    const again = () => {
      // Not under somebody's fingers.
      if (held) return void setTimeout(again, 300);
      keep();
      location.reload();
    };
    setTimeout(again, 1000 * own.reload * (isStale ? 5 : 1));
  }
})();
