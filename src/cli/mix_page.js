'use strict';
(() => {
  const find = id => document.getElementById(id);
  const own = find('mix').dataset, canvas = find('picture');
  const POWERS = Float64Array.from({ length: 32 }, (_, exponent) => 2 ** (Math.max(exponent, 1) - 25));

  /** Value of a 16-bit float. */
  const half = bits => {
    const exponent = bits >> 10 & 31, fraction = bits & 1023, sign = bits & 0x8000 ? -1 : 1;
    // Infinity times 0 is not a number.
    if (exponent === 31) return sign * Infinity * (fraction ? 0 : 1);
    return sign * (exponent ? 1024 + fraction : fraction) * POWERS[exponent];
  };
  /** Numbers of base64 text, times a unit. */
  const decode = (text, unit) => {
    const bytes = atob(text.split(',')[1]), values = new Float64Array(bytes.length / 2);
    for (let i = 0; i < values.length; i++) {
      values[i] = unit * half(bytes.charCodeAt(2 * i) | bytes.charCodeAt(2 * i + 1) << 8);
    }
    return values;
  };
  const lights = [...document.querySelectorAll('.light')].map(node => {
    const data = node.dataset, unit = +data.scale, number = name => name in data ? +data[name] : null;
    const [slider, field] = node.querySelectorAll('input');
    return {
      name: data.name, isKnown: 'known' in data, mean: +data.mean, bias: +data.bias,
      denoised: number('denoised'), seed: data.seed ?? null, factor: +field.value, slider, field,
      radiance: Float32Array.from(decode(data.radiance, unit)), luminance: decode(data.luminance, unit),
      rms: 'rms' in data ? decode(data.rms, unit) : null,
    };
  });

  // Tone curves: crates/image/src/tone.rs and tone_curves.rs.
  const transfer = x => x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055;
  const rollOff = x => x <= 0.7 ? x : 1 - 0.3 * Math.exp((0.7 - x) / 0.3);
  const hable = x => (x * (0.15 * x + 0.05) + 0.004) / (x * (0.15 * x + 0.5) + 0.06) - 0.02 / 0.3;
  const filmic = x => Math.min(1, Math.max(0, hable(Math.min(2 * x, 11.2)) / hable(11.2)));
  const [LOW, HIGH] = [-12.47393, 4.026069];
  const INSET = [0.8424791, 0.04232824, 0.04237565, 0.0784336, 0.8784686, 0.0784336, 0.079223745, 0.07916613, 0.879143];
  const OUTSET = [1.196879, -0.05289685, -0.05297164, -0.09802088, 1.1519031, -0.09804345, -0.09902974, -0.09896118, 1.1510737];
  const FIT = [15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232];
  const agxCurve = x => {
    const log = Math.log2(Math.min(2 ** HIGH, Math.max(2 ** LOW, x)));
    return FIT.reduce((sum, factor) => sum * (log - LOW) / (HIGH - LOW) + factor, 0);
  };
  const product = (columns, [r, g, b]) =>
    [0, 1, 2].map(row => columns[row] * r + columns[row + 3] * g + columns[row + 6] * b);
  const agx = color => product(OUTSET, product(INSET, color).map(agxCurve)).map(x => Math.min(1, Math.max(0, x)));
  const channel = own.curve === 'filmic' ? x => transfer(filmic(x)) : x => transfer(rollOff(x));

  /** Shows the mixture. */
  function draw() {
    // Pixels are computed here: the canvas is better kept in main memory.
    const context = canvas.getContext('2d', { willReadFrequently: true });
    const picture = context.createImageData(canvas.width, canvas.height);
    const sum = new Float32Array(3 * canvas.width * canvas.height);
    for (const { factor, radiance } of lights) {
      if (factor > 0) for (let i = 0; i < sum.length; i++) sum[i] += factor * radiance[i];
    }
    const exposure = own.exposure * 2 ** stops, bytes = picture.data;
    const positive = value => value > 0 ? Math.min(value * exposure, 3.4e38) : 0;
    for (let from = 0, to = 0; from < sum.length; from += 3, to += 4) {
      if (own.curve === 'agx') {
        const color = agx([0, 1, 2].map(i => positive(sum[from + i])));
        for (let i = 0; i < 3; i++) bytes[to + i] = Math.round(255 * color[i]);
      } else {
        for (let i = 0; i < 3; i++) bytes[to + i] = Math.round(255 * channel(positive(sum[from + i])));
      }
      bytes[to + 3] = 255;
    }
    context.putImageData(picture, 0, 0);
  }

  // The sample of pixels: squares with their surroundings, one after the other.
  const [imageWidth, imageHeight] = own.size.split(',').map(Number), AROUND = +own.around;
  let end = 0;
  const squares = own.squares.split(' ').filter(Boolean).map(text => {
    const [left, top, right, bottom, weight] = text.split(',').map(Number);
    const x = Math.max(0, left - AROUND), y = Math.max(0, top - AROUND);
    const across = Math.min(imageWidth, right + AROUND) - x, down = Math.min(imageHeight, bottom + AROUND) - y;
    const start = end;
    end += across * down;
    return { from: [left - x, top - y], to: [right - x, bottom - y], across, down, start, weight };
  });
  const SIGNAL = +own.signalShare, LIT_ONCE = +own.litOnce;

  /** Calls a function with each pixel of a square whose error counts: its index, column and row. */
  const each = (square, call) => {
    for (let y = square.from[1]; y < square.to[1]; y++) {
      for (let x = square.from[0]; x < square.to[0]; x++) call(square.start + y * square.across + x, x, y);
    }
  };
  /** Mean luminance around a pixel, without pixels that were lit once if most others were lit more often. */
  function meanAround(luminance, variance, { start, across, down }, x, y) {
    let sum = 0, count = 0, often = 0, light = 0;
    for (let row = Math.max(0, y - AROUND); row < Math.min(down, y + AROUND + 1); row++) {
      for (let column = Math.max(0, x - AROUND); column < Math.min(across, x + AROUND + 1); column++) {
        const at = start + row * across + column, value = luminance[at], square = value * value;
        sum += value;
        count++;
        if (value > 0 && square - variance[at] >= LIT_ONCE * square) { often++; light += value; }
      }
    }
    return often > 0.5 * count ? light / often : sum / count;
  }
  /** Luminance without noise. */
  function clean(luminance, variance, square, at, x, y) {
    const squared = luminance[at] * luminance[at], signal = squared - variance[at];
    return signal > SIGNAL * squared ? Math.sqrt(signal) : Math.max(0, meanAround(luminance, variance, square, x, y));
  }
  /** Lights of one seed, whose errors add up. */
  const bySeed = on => {
    const groups = new Map();
    for (const light of on) groups.set(light.seed, [...groups.get(light.seed) ?? [], light]);
    return [...groups.values()];
  };
  const varianceOf = (groups, error) => {
    let sum = 0;
    for (const group of groups) {
      let own = 0;
      for (const light of group) own += light.factor * error(light);
      sum += own * own;
    }
    return sum;
  };
  /** Error of a pixel that is a relative error of 1. */
  const unit = (light, at) => {
    const floor = 0.01 * light.mean * light.mean;
    return floor > 0 ? Math.sqrt(light.luminance[at] * light.luminance[at] + floor) : 1;
  };
  const total = on => on.reduce((sum, light) => sum + light.factor * light.mean, 0);

  /** Luminance without noise of the pixels whose error counts, and its mean over the image. */
  function cleanImage(on, groups) {
    const luminance = new Float64Array(end), variance = new Float64Array(end), result = new Float64Array(end);
    for (let at = 0; at < end; at++) for (const light of on) luminance[at] += light.factor * light.luminance[at];
    const hasNoise = on.every(light => light.rms);
    if (hasNoise) for (let at = 0; at < end; at++) variance[at] = varianceOf(groups, light => light.rms[at]);
    let sum = 0;
    for (const square of squares) {
      each(square, (at, x, y) => {
        result[at] = hasNoise ? clean(luminance, variance, square, at, x, y) : luminance[at];
        sum += result[at];
      });
    }
    const mean = 'cleanShare' in own ? own.cleanShare * total(on) : sum / (imageWidth * imageHeight);
    return [result, mean];
  }
  /** Error of the mixture as bdpm mix states it: docs/explanation/theory/lights.md (19e). */
  function mixtureError() {
    const on = lights.filter(light => light.factor > 0), unknown = on.filter(light => !light.isKnown);
    if (unknown.length) return { unknown: unknown.map(light => light.name) };
    const groups = bySeed(on), [luminance, mean] = cleanImage(on, groups), floor = 0.01 * mean * mean;
    const raw = on.filter(light => light.denoised === null);
    let noise = 0, bias = 0;
    for (const square of squares) {
      const scale = square.weight / (imageWidth * imageHeight);
      each(square, at => {
        const weight = floor > 0 ? scale / (luminance[at] * luminance[at] + floor) : scale;
        noise += weight * varianceOf(groups, light =>
          light.denoised === null ? light.rms[at] : light.denoised * unit(light, at));
        let sum = 0;
        for (const light of raw) sum += light.factor * light.bias * unit(light, at);
        bias += weight * sum * sum;
      });
    }
    const isDenoised = raw.length < on.length;
    return { total: Math.sqrt(noise + bias), noise: Math.sqrt(noise), bias: Math.sqrt(bias), isDenoised };
  }

  const percent = share => (100 * share).toFixed(2) + ' %';
  function state() {
    const error = mixtureError();
    find('error').value = error.unknown ? 'unknown' : percent(error.total);
    find('parts').textContent = error.unknown ? 'No image states that of ' + error.unknown.join(', ') + '.'
      : error.isDenoised ? 'denoised' : `noise ${percent(error.noise)}, bias ${percent(error.bias)}`;
    find('mean').textContent = total(lights).toFixed(4);
  }
  const isPlain = word => /^[\p{L}\p{N}_./:=,%+@-]+$/u.test(word);
  const quoted = word => isPlain(word) ? word : `'${word.replaceAll("'", "'\\''")}'`;
  /** The command of the mixture. A star in a name stands for other names too, which follow it then. */
  function command() {
    const stars = lights.filter(light => light.name.includes('*'));
    const others = lights.filter(light => !light.name.includes('*'));
    const set = [...stars, ...others].filter(light => light.factor !== 1 || stars.length);
    const words = set.map(({ name, factor }) =>
      (name.startsWith('-') ? '--set=' : '--set ') + quoted(`${name}=${+factor.toPrecision(6)}`));
    find('command').textContent = [own.command, ...words, '--output mixture.exr'].join(' ');
    find('copied').textContent = '';
  }

  const stopsSlider = find('stops'), stopsField = find('stops-number');
  let stops = +stopsField.value;
  const show = () => { draw(); state(); command(); };
  /** Joins a slider and its field, which may go beyond the scale of the slider. */
  const join = (slider, field, write) => {
    slider.addEventListener('input', () => { field.value = slider.value; write(+slider.value); });
    field.addEventListener('input', () => {
      if (!field.value || !field.checkValidity()) return;
      slider.value = field.value;
      write(+field.value);
    });
  };
  for (const light of lights) {
    join(light.slider, light.field, value => { light.factor = value; show(); });
  }
  join(stopsSlider, stopsField, value => { stops = value; draw(); });
  find('reset').addEventListener('click', () => {
    for (const light of lights) light.slider.value = light.field.value = light.factor = 1;
    stopsSlider.value = stopsField.value = stops = 0;
    show();
  });
  find('copy').addEventListener('click', async () => {
    const note = find('copied');
    try {
      await navigator.clipboard.writeText(find('command').textContent);
      note.textContent = 'copied';
    } catch {
      getSelection().selectAllChildren(find('command'));
      note.textContent = 'selected: copy it by Ctrl+C';
    }
  });

  show();
})();
