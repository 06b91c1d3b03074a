'use strict';
(() => {
  const find = id => document.getElementById(id);
  const own = find('dimming');
  const all = (selector, node = own) => [...node.querySelectorAll(selector)];
  /** Bytes of base64 text. */
  const decode = text => Uint8Array.from(atob(text.split(',')[1]), character => character.charCodeAt(0));
  const doubles = text => new Float64Array(decode(text).buffer);
  const singles = text => new Float32Array(decode(text).buffer);
  /** Not a number, which stands for what is not known. */
  const UNKNOWN = 0 / 0;

  const lights = all('.light').map(node => {
    const [slider, field] = all('input', node);
    return { name: node.dataset.name, factor: 1, slider, field };
  });
  /** Sets of meters with their readings under each light. A reading is the interval value +- (spread + bias). */
  const sets = all('.measured').map(node => {
    const data = node.dataset;
    const groups = all('i', node).map(({ dataset }) => {
      const value = doubles(dataset.value), [mean, noise, bias, spread, direct] = doubles(dataset.mean);
      return {
        mean: { value: mean, noise, bias, spread, direct }, open: +dataset.open, value,
        noise: singles(dataset.noise), spread: singles(dataset.spread),
        bias: 'bias' in dataset ? singles(dataset.bias) : new Float32Array(value.length),
      };
    });
    return {
      groups, unit: data.unit, columns: +data.columns, rows: +data.rows, factorOfAll: +data.factorOfAll,
      maintenance: +data.maintenance, required: JSON.parse(data.required), hasTable: 'table' in data,
    };
  });

  // Readings: crates/job/src/measurement/reading.rs.
  const DARK = { value: 0, noise: 0, bias: 0, spread: 0, direct: 0 };
  /** Sum of independent readings, each times the factor of its light. Lights that are off count for nothing. */
  const mixed = (of, factors) => factors.reduce((sum, factor, light) => {
    if (factor === 0) return sum;
    const next = of(light);
    return {
      value: sum.value + factor * next.value,
      noise: Math.hypot(sum.noise, factor * next.noise),
      bias: sum.bias + factor * next.bias,
      spread: Math.hypot(sum.spread, factor * next.spread),
      direct: sum.direct + factor * next.direct,
    };
  }, DARK);
  const expanded = reading => reading.spread + reading.bias;
  const estimated = reading => ({ value: reading.value, expanded: expanded(reading) });
  const isKnown = reading => Number.isFinite(reading.value);
  /** Half of the width of the interval over the value, percent. */
  const relative = reading => {
    const width = expanded(reading);
    if (width === 0) return 0;
    return reading.value > 0 && isKnown(reading) && Number.isFinite(width) ? 100 * (width / reading.value) : UNKNOWN;
  };

  // Minimum and maximum: crates/job/src/measurement/extremes.rs. Minimum and maximum of numbers leave out what is
  // not known.
  const NOTHING = { value: UNKNOWN, expanded: UNKNOWN };
  const lower = (a, b) => b < a || a !== a ? b : a;
  const higher = (a, b) => b > a || a !== a ? b : a;
  function extremes(readings, factorOfAll) {
    if (!readings.length || !readings.every(isKnown)) return [NOTHING, NOTHING];
    if (readings.length === 1) return [estimated(readings[0]), estimated(readings[0])];
    const count = readings.length, sum = of => readings.reduce((total, reading) => total + of(reading), 0);
    const mean = sum(reading => reading.value) / count;
    const spread = sum(reading => (reading.value - mean) ** 2) / (count - 1);
    const varies = higher(spread - sum(reading => reading.noise ** 2) / count, 0);
    const drawn = reading => {
      const variance = varies + reading.noise ** 2;
      return mean + (variance > 0 ? varies / variance : 1) * (reading.value - mean);
    };
    const width = reading => factorOfAll * reading.spread + reading.bias;
    return [1, -1].map(sign => {
      const least = of => readings.reduce((most, reading) => lower(most, sign * of(reading)), Infinity);
      const low = least(reading => reading.value - sign * width(reading));
      const high = least(reading => reading.value + sign * width(reading));
      const value = Math.min(Math.max(least(drawn), low), high);
      return { value: sign * value, expanded: higher(high - value, value - low) };
    });
  }
  const ratio = (one, other) => {
    const value = one.value / other.value;
    if (!Number.isFinite(value)) return NOTHING;
    return { value, expanded: Math.hypot(one.expanded / other.value, value * other.expanded / other.value) };
  };

  /** What the meters of a set read if the lights have these factors. */
  function measured(set, factors) {
    const at = point => mixed(light => {
      const { value, noise, bias, spread } = set.groups[light];
      return { value: value[point], noise: noise[point], bias: bias[point], spread: spread[point], direct: 0 };
    }, factors);
    const readings = Array.from(set.groups[0].value, (_, point) => at(point));
    const mean = mixed(light => set.groups[light].mean, factors), [least, most] = extremes(readings, set.factorOfAll);
    return {
      readings, mean, least, most, uniformity: ratio(least, estimated(mean)), diversity: ratio(least, most),
      isOpen: set.groups.some((group, light) => factors[light] !== 0 && group.open > 0),
    };
  }

  // Text: src/cli/measure/digits.rs and page.rs.
  const digitsOf = width => {
    const size = Math.abs(width);
    return size > 0 && Number.isFinite(size) ? Math.min(Math.max(1 - Math.floor(Math.log10(size)), 0), 6) : 1;
  };
  const uncertain = (value, digits) => Number.isFinite(value) ? value.toFixed(digits) : 'unknown';
  const halfWidth = (width, digits) => (Number.isFinite(width) ? '±' : '') + uncertain(width, digits);
  /** Writes texts into the last cells of a row. */
  const write = (row, texts) => {
    const cells = [...row.cells].slice(-texts.length);
    texts.forEach((text, i) => { cells[i].textContent = text; });
  };

  function writeReading(row, reading, unit) {
    const { value, noise, bias, direct } = reading, width = expanded(reading), digits = digitsOf(width);
    const shown = number => number.toFixed(digits);
    write(row, !isKnown(reading) ? ['unknown', '', '', '', '', ''] : [
      `${shown(value)} ${unit}`, halfWidth(width, digits), uncertain(noise, digits), uncertain(bias, digits),
      shown(direct), shown(value - direct),
    ]);
  }
  function writeExtreme(row, { value, expanded: width }, unit) {
    const digits = digitsOf(width);
    const shown = Number.isFinite(value) ? `${value.toFixed(digits)} ${unit}` : 'unknown';
    write(row, [shown, Number.isFinite(value) ? halfWidth(width, digits) : '', '', '', '', '']);
  }

  // Requirements: crates/job/src/measurement/requirement.rs.
  const verdict = ({ value, expanded: width }, required, isOpen) =>
    value - width >= required ? 'met'
      : value + width < required && !isOpen ? 'not met' : 'not decided: measure longer';
  function writeRequirement(row, what, required, set, now) {
    const maintained = ({ value, expanded: width }) =>
      ({ value: set.maintenance * value, expanded: set.maintenance * width });
    const found = {
      'maintained mean': () => [maintained(estimated(now.mean)), set.unit],
      'maintained minimum': () => [maintained(now.least), set.unit],
      'uniformity U0': () => [now.uniformity, ''],
      'diversity Ud': () => [now.diversity, ''],
    }[what];
    // Glare is no sum over lights: its row says that they are at full strength.
    if (!found) return;
    const [estimate, unit] = found(), digits = unit ? digitsOf(estimate.expanded) : 3;
    write(row, [`${uncertain(estimate.value, digits)} ${unit}`, halfWidth(estimate.expanded, digits)]
      .concat(verdict(estimate, required, now.isOpen)));
    const cell = row.cells[row.cells.length - 1], strong = document.createElement('strong');
    strong.append(cell.textContent);
    cell.replaceChildren(strong);
  }

  // Maps: crates/report/src/picture.rs and crates/image/src/scale.rs.
  const colors = decode(own.dataset.colors);
  const tickStep = (max, steps) => {
    const rough = max / steps, power = 10 ** Math.floor(Math.log10(rough));
    return (([1, 2, 5].find(factor => factor * power >= rough * (1 - 1e-9))) ?? 10) * power;
  };
  /** Three significant digits without trailing zeros. */
  const number = value => {
    if (value === 0) return '0';
    if (value < 1e-3 || value >= 1e5) return value.toExponential(2).replace('e+', 'e');
    const text = value.toFixed(Math.max(2 - Math.floor(Math.log10(value)), 0));
    return text.includes('.') ? text.replace(/\.?0+$/, '') : text;
  };
  /** Step and end of the scale of a map, which covers nearly all of its values. */
  const scaleOf = values => {
    const known = Float64Array.from(values, Math.abs).filter(Number.isFinite).sort();
    const covered = known.length ? known[Math.ceil(own.dataset.covered * (known.length - 1))] : 0;
    const most = covered > 0 ? covered : 1, step = tickStep(most, own.dataset.steps);
    return { step, end: Math.ceil(most / step) * step };
  };
  const isAbove = / [\d\u202f]+ pixels lie outside the scale\.$/;
  /** A map of a page. Its scale is at least that of all lights at full strength. */
  function mapOf(figure, { columns, rows }, full) {
    const image = figure.querySelector('img'), caption = figure.querySelector('figcaption');
    const ticks = figure.querySelector('.ticks'), start = scaleOf(full);
    const text = caption.textContent.replace(isAbove, '');
    const canvas = document.createElement('canvas');
    [canvas.width, canvas.height, canvas.role, canvas.ariaLabel] = [columns, rows, 'img', image.alt];
    image.replaceWith(canvas);
    const context = canvas.getContext('2d', { willReadFrequently: true });
    return values => {
      const needed = scaleOf(values), { step, end } = needed.end > start.end ? needed : start;
      const picture = context.createImageData(columns, rows);
      values.forEach((value, i) => {
        const color = 3 * Math.min(Math.max(Math.round(255 * (value / end)), 0) || 0, 255);
        picture.data.set([...colors.subarray(color, color + 3), 255], 4 * i);
      });
      context.putImageData(picture, 0, 0);
      ticks.replaceChildren(...Array.from({ length: Math.floor(end / step + 1e-9) + 1 }, (_, i) => {
        const tick = document.createElement('span');
        tick.style.left = `${(100 * (i * step / end)).toFixed(2)}%`;
        tick.textContent = number(i * step);
        return tick;
      }));
      const above = values.filter(value => Math.abs(value) > end).length;
      const count = String(above).replace(/\B(?=(\d{3})+$)/g, '\u202f');
      caption.textContent = text + (above ? ` ${count} pixels lie outside the scale.` : '');
    };
  }

  // Isolines: crates/light/src/isolines.rs and false_color.rs.
  /** Round values along the scale of a grid. */
  const levelsOf = values => {
    const positive = Float64Array.from(values).filter(value => value > 0 && value < Infinity).sort();
    const high = positive.length ? positive[Math.round(0.995 * (positive.length - 1))] : 1, step = tickStep(high, 10);
    return Array.from({ length: Math.floor(high / step + 1e-9) + 1 }, (_, i) => i * step);
  };
  /** Pairs of crossed edges that a line joins. An edge is between a point and the next one, or the one below. */
  function segments(values, columns, rows, level) {
    const pairs = [];
    for (let y = 0; y + 1 < rows; y++) {
      for (let x = 0; x + 1 < columns; x++) {
        const at = y * columns + x, corners = [at, at + 1, at + columns + 1, at + columns].map(i => values[i]);
        if (!corners.every(Number.isFinite)) continue;
        const above = corners.map(value => value >= level);
        const edges = [2 * at, 2 * (at + 1) + 1, 2 * (at + columns), 2 * at + 1];
        const crossed = edges.filter((_, i) => above[i] !== above[(i + 1) % 4]);
        if (crossed.length === 2) pairs.push(crossed);
        if (crossed.length < 4) continue;
        // In a saddle, the mean of the corners decides which of them are joined.
        const middle = corners.reduce((sum, value) => sum + value, 0) / 4 >= level, [top, right, bottom, left] = edges;
        pairs.push(...middle === above[0] ? [[top, right], [bottom, left]] : [[left, top], [right, bottom]]);
      }
    }
    return pairs;
  }
  /** Lines of points, columns and rows from the first one. The last point is the first if the line is closed. */
  function isolines(values, columns, rows, level) {
    const next = new Map();
    for (const [a, b] of segments(values, columns, rows, level)) {
      for (const [from, to] of [[a, b], [b, a]]) {
        if (!next.has(from)) next.set(from, []);
        next.get(from).push(to);
      }
    }
    const crossing = edge => {
      const at = edge >> 1, isDown = edge & 1, other = at + (isDown ? columns : 1);
      const share = (level - values[at]) / (values[other] - values[at]), x = at % columns, y = Math.floor(at / columns);
      return isDown ? [x, y + share] : [x + share, y];
    };
    const edges = [...next.keys()], ends = edges.filter(edge => next.get(edge).length === 1);
    return [...ends, ...edges].map(start => {
      const line = [crossing(start)];
      for (let at = start, to; (to = next.get(at).pop()) !== undefined; at = to) {
        const back = next.get(to);
        back.splice(back.indexOf(at), 1);
        line.push(crossing(to));
      }
      return line;
    }).filter(line => line.length > 1);
  }
  function drawLines(svg, values, { columns, rows, unit }) {
    const cell = svg.viewBox.baseVal.width / columns, place = at => ((at + 0.5) * cell).toFixed(2);
    const add = (name, attributes, text) => {
      const node = document.createElementNS(svg.namespaceURI, name);
      for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
      node.textContent = text;
      svg.append(node);
    };
    svg.querySelectorAll('polyline, text').forEach(node => node.remove());
    for (const level of levelsOf(values)) {
      for (const line of isolines(values, columns, rows, level)) {
        const [x, y] = line[Math.floor(line.length / 2)].map(place);
        add('polyline', { fill: 'none', stroke: 'black', points: line.map(point => point.map(place)).join(' ') }, '');
        add('text', { x, y, 'paint-order': 'stroke', stroke: 'white', 'stroke-width': 3 }, `${number(level)} ${unit}`);
      }
    }
  }

  // Points: src/cli/measure/page.rs.
  function writePoint(cell, reading) {
    const width = expanded(reading), digits = digitsOf(width), small = document.createElement('small');
    small.textContent = halfWidth(width, digits);
    cell.replaceChildren(...isKnown(reading)
      ? [reading.value.toFixed(digits), document.createElement('br'), small] : ['unknown']);
  }

  // What follows the sliders, in the order of the page.
  const rows = all('.readings tbody tr'), requirements = all('.requirements tbody tr');
  const figures = all('figure.picture'), tables = all('table.points'), drawings = all('.lines svg');
  for (const set of sets) {
    const isGrid = set.groups[0].value.length > 1;
    set.tableRows = rows.splice(0, 1 + lights.length + (isGrid ? 4 : 0));
    set.requirementRows = requirements.splice(0, set.required.length);
    const full = measured(set, lights.map(() => 1)).readings;
    set.maps = isGrid ? [reading => reading.value, relative].map(of => {
      const map = mapOf(figures.shift(), set, full.map(of));
      return readings => map(readings.map(of));
    }) : [];
    set.lines = set.columns > 1 && set.rows > 1 ? [drawings.shift()] : [];
    set.cells = set.hasTable ? all('td', tables.shift()) : [];
  }

  function show() {
    const now = lights.map(light => light.factor);
    for (const set of sets) {
      const result = measured(set, now), [mean, ...rest] = set.tableRows;
      writeReading(mean, result.mean, set.unit);
      lights.forEach((_, light) => {
        const alone = now.map((factor, other) => other === light ? factor : 0);
        writeReading(rest[light], mixed(group => set.groups[group].mean, alone), set.unit);
      });
      const [least, most, uniformity, diversity] = rest.slice(lights.length);
      if (least) {
        writeExtreme(least, result.least, set.unit);
        writeExtreme(most, result.most, set.unit);
        writeExtreme(uniformity, result.uniformity, '');
        writeExtreme(diversity, result.diversity, '');
      }
      set.required.forEach(([what, required], i) => writeRequirement(set.requirementRows[i], what, required, set, result));
      set.maps.forEach(draw => draw(result.readings));
      set.lines.forEach(svg => drawLines(svg, result.readings.map(reading => reading.value), set));
      set.cells.forEach((cell, point) => writePoint(cell, result.readings[point]));
    }
    const others = lights.filter(light => light.factor !== 1)
      .map(light => `${light.name}\u00a0${+light.factor.toPrecision(6)}`);
    find('state').textContent = !others.length ? 'All lights at full strength.'
      : `Strengths: ${others.join(', ')}.${others.length < lights.length ? ' Others are at full strength.' : ''}`;
  }

  const set = (light, factor) => { light.slider.value = light.field.value = light.factor = factor; };
  for (const light of lights) {
    light.slider.addEventListener('input', () => { set(light, +light.slider.value); show(); });
    light.field.addEventListener('input', () => {
      if (!light.field.value || !light.field.checkValidity()) return;
      light.slider.value = light.factor = +light.field.value;
      show();
    });
  }
  find('reset').addEventListener('click', () => { lights.forEach(light => set(light, 1)); show(); });
  show();
})();
