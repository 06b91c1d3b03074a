// What is checked of every page that bdpm writes, in a frame that shows it: pictures are there, nothing comes from
// elsewhere, nothing is cut off or beyond the edge, labels can be read.

/** Opens the page in a frame so many pixels wide. */
function open(page, width) {
  const frame = document.createElement('iframe');
  frame.style = `width:${width}px;height:1000px;border:0`;
  frame.src = page;
  document.body.append(frame);
  return frame;
}

/** What is wrong in one frame; `more` looks for what else may be. */
function problems(frame, width, more) {
  const page = frame.contentDocument, found = [];
  const fail = (what, node) => {
    const text = node?.textContent.trim().replace(/\s+/g, ' ').slice(0, 60);
    found.push(`at ${width} pixels: ${what}${node ? ` in ${node.tagName.toLowerCase()}: ${text}` : ''}`);
  };
  const all = selector => [...page.querySelectorAll(selector)];
  more(all, fail);
  for (const image of all('img')) {
    if (!image.complete || image.naturalWidth === 0) fail(`picture not loaded (${image.alt})`);
    if (image.getBoundingClientRect().width < 100) fail(`picture too small (${image.alt})`);
  }
  for (const resource of all('[src], link[href]')) {
    const source = resource.getAttribute('src') ?? resource.getAttribute('href');
    if (!source.startsWith('data:')) fail(`${source} is not part of the file`);
  }
  // The page does not scroll sideways; wide tables do, by themselves.
  if (page.documentElement.scrollWidth > width) fail('the page is wider than the window');
  for (const node of all('main *')) {
    const box = node.getBoundingClientRect();
    if (box.width === 0 || node.closest('svg, .scroll')) continue;
    if (box.left < -1 || box.right > width + 1) fail('beyond the edge', node);
    const style = frame.contentWindow.getComputedStyle(node);
    if (style.overflowX === 'hidden' && node.scrollWidth > node.clientWidth) fail('cut off', node);
  }
  for (const scroll of all('.scroll')) {
    const style = frame.contentWindow.getComputedStyle(scroll);
    if (scroll.scrollWidth > scroll.clientWidth && style.overflowX !== 'auto') fail('cut off', scroll);
  }
  for (const svg of all('.plot svg')) {
    const frame = svg.getBoundingClientRect();
    for (const text of svg.querySelectorAll('text')) {
      const box = text.getBoundingClientRect();
      const inside = box.left >= frame.left - 1 && box.right <= frame.right + 1 &&
        box.top >= frame.top - 1 && box.bottom <= frame.bottom + 1;
      if (!inside) fail('label outside of its plot', text);
      if (box.height < 9) fail(`label ${box.height.toFixed(1)} pixels high`, text);
    }
  }
  for (const ticks of all('.ticks')) {
    const labels = [...ticks.children].map(label => label.getBoundingClientRect());
    labels.slice(1).forEach((box, i) => {
      if (box.left < labels[i].right + 2) fail('numbers of a scale overlap', ticks);
    });
  }
  return found;
}

/** Text against what is behind it, by WCAG 2: a contrast of 4.5 is required. */
function contrasts(all, fail) {
  const parse = text => text.match(/[\d.]+/g).map(Number);
  const color = (node, name) => parse(node.ownerDocument.defaultView.getComputedStyle(node)[name]);
  const background = node => {
    for (let at = node; at; at = at.parentElement) {
      const [r, g, b, a = 1] = color(at, 'backgroundColor');
      if (a > 0) return [r, g, b];
    }
    return [255, 255, 255];
  };
  const luminance = rgb => {
    const linear = rgb.map(x => x / 255).map(x => x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
  };
  for (const node of all('p, dt, dd, td, th, h1, h2, span, figcaption, button, code, label, output')) {
    if (!node.textContent.trim() || node.closest('.label, .ticks')) continue;
    const both = [luminance(color(node, 'color').slice(0, 3)), luminance(background(node))];
    const [light, dark] = both.sort((a, b) => b - a);
    const contrast = (light + 0.05) / (dark + 0.05);
    if (contrast < 4.5) fail(`contrast of ${contrast.toFixed(2)}`, node);
  }
}

/** Resolves once a frame or a picture has loaded. */
const loaded = node => new Promise((done, failed) => {
  node.addEventListener('load', done, { once: true });
  node.addEventListener('error', () => failed(`${node.src} does not load`), { once: true });
});
/** Ends the check if something does not hold. */
const expect = (is, what) => { if (!is) throw what; };

/** The bytes of a picture's pixels. */
function pixels(image) {
  const canvas = document.createElement('canvas');
  [canvas.width, canvas.height] = [image.naturalWidth, image.naturalHeight];
  const context = canvas.getContext('2d');
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, canvas.width, canvas.height).data;
}
