// What the pages that compute themselves share: elements, drawings, sliders, questions. No library.
const Live = (() => {
  const SVG = "http://www.w3.org/2000/svg";

  function filled(made, attributes, children) {
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    made.append(...children);
    return made;
  }

  const element = (name, attributes = {}, ...children) => filled(document.createElement(name), attributes, children);
  const shape = (name, attributes = {}, ...children) => filled(document.createElementNS(SVG, name), attributes, children);
  const drawing = (width, height, label) => shape("svg", {viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label});

  // A map of metres onto a drawing: its upper left corner is at (left, top) [m], and it has `unit` units a metre.
  function map(left, top, unit) {
    const column = x => (x - left) * unit, row = y => (top - y) * unit;
    const circle = ([x, y], radius, kind) => shape("circle", {cx: column(x), cy: row(y), r: radius * unit, class: kind});
    const place = (svg, event) => {
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      return [at.x / unit + left, top - at.y / unit];
    };
    return {column, row, circle, place};
  }

  // Calls begin(place [m]) when the pointer goes down on a drawing; if that is true, move(place) until it goes up.
  function follow(svg, {place}, begin, move) {
    let held = false;
    svg.addEventListener("pointerdown", event => {
      held = begin(place(svg, event));
      if (held) svg.setPointerCapture(event.pointerId);
    });
    svg.addEventListener("pointermove", event => { if (held) move(place(svg, event)); });
    for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => { held = false; });
  }

  // A labelled slider over given values: changed(value) is called when it moves; write(value) makes its text.
  function slider(id, label, values, start, write, changed) {
    const input = element("input", {type: "range", id, min: 0, max: values.length - 1, step: 1});
    const output = element("output", {for: id});
    const show = () => {
      output.textContent = write(values[input.value]);
      input.setAttribute("aria-valuetext", output.textContent);
    };
    input.value = values.indexOf(start);
    input.addEventListener("input", () => { show(); changed(values[input.value]); });
    show();
    const set = value => { input.value = values.indexOf(value); show(); };
    return {row: element("p", {}, element("label", {for: id}, label), input, output), set};
  }

  function choice(id, label, options, changed) {
    const select = element("select", {id});
    for (const [value, words] of Object.entries(options)) select.append(element("option", {value}, words));
    select.addEventListener("change", () => changed(select.value));
    return element("p", {}, element("label", {for: id}, label), select);
  }

  // Units that an answer may be written with, by what they measure; refsim/io/exercises.py has those of the lessons.
  const UNITS = [
    {"": 1, "%": 0.01},
    {m: 1, dm: 0.1, cm: 0.01, mm: 0.001},
    {"°": 1, degrees: 1, rad: 180 / Math.PI},
    {particles: 1, particle: 1},
    {spacings: 1, spacing: 1, d: 1},
    {kPa: 1, Pa: 0.001},
    {"kg/(m s)": 1},
  ];

  // The number that was written, such as 0.5, 0,5, 3/16 or 12 cm, in a unit; NaN for anything else, another unit too.
  function number(text, unit = "") {
    const found = text.trim().replace(/,/g, ".").replace(/−/g, "-").match(/^([-+]?[\d.]+(?:e[-+]?\d+)?)\s*(?:\/\s*([\d.]+))?\s*(\D*)$/i);
    if (!found) return NaN;
    const units = UNITS.find(some => Object.hasOwn(some, unit)), written = found[3].trim() || unit;
    return Object.hasOwn(units, written) ? Number(found[1]) / Number(found[2] ?? 1) * units[written] / units[unit] : NaN;
  }

  // {right, says}: `one` has right and wrong, lists of [least, largest, sentence], a hint for any other answer, and a unit.
  function judged(one, text) {
    const value = number(text, one.unit);
    const unit = one.unit ? `, in ${one.unit}` : "";
    if (!Number.isFinite(value)) return {right: false, says: `Write one number, such as 0.5 or 3/16${unit}.`};
    const within = ([least, largest]) => least <= value && value <= largest;
    const right = one.right.find(within);
    if (right) return {right: true, says: `Right. ${right[2]}`};
    return {right: false, says: `Not yet. ${(one.wrong.find(within) ?? [0, 0, one.hint])[2]}`};
  }

  function questions(list) {
    return element("ol", {class: "questions"}, ...list.map((one, k) => {
      const answer = element("input", {id: `answer${k + 1}`, inputmode: "decimal", autocomplete: "off", size: 8});
      const says = element("output", {for: answer.id, "aria-live": "polite"});
      const form = element("form", {}, element("label", {for: answer.id}, one.asks), answer,
        element("button", {}, "Check"), says);
      form.addEventListener("submit", event => {
        event.preventDefault();
        const found = judged(one, answer.value);
        says.textContent = found.says;
        form.dataset.right = found.right;
      });
      return element("li", {}, form);
    }));
  }

  // Numbers in [0, 1), the same on every visit.
  function random(seed) {
    return () => (seed = (1664525 * seed + 1013904223) % 2 ** 32) / 2 ** 32;
  }

  // Wendland's C2 kernel in the plane [1/m^2], and its slope [1/m^3].
  function kernel(r, h) {
    const q = Math.min(r / h, 1);
    return 7 / (Math.PI * h * h) * (1 - q) ** 4 * (1 + 4 * q);
  }

  function slope(r, h) {
    const q = Math.min(r / h, 1);
    return -140 / (Math.PI * h ** 3) * q * (1 - q) ** 3;
  }

  return {element, shape, drawing, map, follow, slider, choice, number, judged, questions, random, kernel, slope};
})();
