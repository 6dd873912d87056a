// A liquid in the page: canvas, energy meter, switches and questions around liquid.js.
const LiquidPage = (() => {
  const {element, shape, drawing} = Live;
  const SPACINGS = {0.05: [10, 20], 0.025: [20, 40], 0.0166667: [30, 60]};  // [m]: columns and rows of liquid
  const COLD = [86, 180, 233], WARM = [213, 94, 0];  // colours of the least and largest value
  const state = {settings: {}, chosen: 0, begun: 0, curve: [], running: false};
  const box = document.getElementById("liquid"), page = PAGES[box.dataset.page];
  const [LEFT, RIGHT, BOTTOM, TOP] = page.view ?? [-0.2, 2.2, -0.2, 1.6];  // of the canvas [m]
  const PIXELS = 960 / (RIGHT - LEFT);  // a metre
  const sum = values => values.reduce((total, one) => total + one, 0);
  const still = () => matchMedia("(prefers-reduced-motion: reduce)").matches;

  // Of the particle i: the share of the density by itself and its neighbours, and the terms V grad W [1/m] of these.
  function around(liquid, i) {
    const {x, mass} = liquid, volume = mass / Liquid.DENSITY, terms = [];
    let total = volume * Liquid.weight(liquid, 0);
    for (let j = 0; j < x.length / 2; j++) {
      const vector = [x[2 * i] - x[2 * j], x[2 * i + 1] - x[2 * j + 1]], r = Math.hypot(...vector);
      if (j === i || r >= liquid.h) continue;
      total += volume * Liquid.weight(liquid, r);
      terms.push(vector.map(part => volume * Liquid.slope(liquid, r) * part));
    }
    return {total, terms, gradient: [0, 1].map(axis => sum(terms.map(term => term[axis])))};
  }

  const canvas = element("canvas", {width: PIXELS * (RIGHT - LEFT), height: PIXELS * (TOP - BOTTOM), tabindex: 0, role: "application",
    "aria-label": "The liquid. Arrow keys choose a particle, the space bar starts and stops, Enter makes ten steps."});
  const said = element("p", {class: "said", "aria-live": "polite"}), clock = element("p", {class: "count"});
  const meter = drawing(400, 150, "Energy over that at the start: kinetic, potential, compression, and below their sum in time");
  const column = x => PIXELS * (x - LEFT), row = y => PIXELS * (TOP - y);

  function draw() {
    const {liquid} = state, {x, v, n, spacing} = liquid, pen = canvas.getContext("2d"), style = getComputedStyle(canvas);
    const ink = style.color;
    const circle = (k, radius, act) => { pen.beginPath(); pen.arc(column(x[2 * k]), row(x[2 * k + 1]), PIXELS * radius, 0, 2 * Math.PI); pen[act](); };
    const values = page.colour === "density" ? Liquid.density(liquid, Liquid.pairs(liquid)).map(rho => (rho / Liquid.DENSITY - 0.5) / 0.55)
      : Float64Array.from({length: n}, (_, k) => Math.hypot(v[2 * k], v[2 * k + 1]) / 4);
    pen.clearRect(0, 0, canvas.width, canvas.height);
    pen.fillStyle = `color-mix(in srgb, ${ink} 45%, transparent)`;
    for (let k = n; k < x.length / 2; k++) circle(k, 0.3 * spacing, "fill");
    for (let k = 0; k < n; k++) {
      const part = Math.min(Math.max(values[k], 0), 1);
      pen.fillStyle = `rgb(${COLD.map((cold, c) => Math.round(cold + part * (WARM[c] - cold))).join()})`;
      circle(k, 0.45 * spacing, "fill");
    }
    pen.strokeStyle = ink;
    pen.lineWidth = 3;
    circle(state.chosen, 0.45 * spacing, "stroke");
    pen.setLineDash([8, 6]);
    circle(state.chosen, liquid.h, "stroke");
    pen.setLineDash([]);
    const seen = around(liquid, state.chosen);
    for (const term of seen.terms) arrow(pen, term, 1.5);
    pen.strokeStyle = "#cc79a7";
    arrow(pen, seen.gradient, 6);
    said.textContent = `Particle ${state.chosen + 1}: sum of V W = ${seen.total.toFixed(3)}, of V ∇W = `
      + `(${seen.gradient.map(part => (Math.abs(part) < 0.05 ? 0 : part).toFixed(1)).join(", ")}) 1/m, ${seen.terms.length} neighbours.`;
    gauge();
  }

  // An arrow at the chosen particle, a spacing long for a term of 0.1/d.
  function arrow(pen, [across, up], width) {
    const {x, spacing} = state.liquid, scale = 10 * spacing ** 2 * PIXELS, [dx, dy] = [across * scale, -up * scale];
    const [from, to] = [column(x[2 * state.chosen]), row(x[2 * state.chosen + 1])];
    pen.lineWidth = width;
    pen.beginPath();
    pen.moveTo(from, to);
    pen.lineTo(from + dx, to + dy);
    for (const turn of [2.7, -2.7]) {
      pen.moveTo(from + dx, to + dy);
      pen.lineTo(from + dx + 0.3 * (dx * Math.cos(turn) - dy * Math.sin(turn)), to + dy + 0.3 * (dx * Math.sin(turn) + dy * Math.cos(turn)));
    }
    pen.stroke();
  }

  function gauge() {
    const now = Liquid.energy(state.liquid), share = now.map(part => part / state.begun), [px, py] = Liquid.momentum(state.liquid);
    state.curve.push([state.liquid.time, sum(share)]);
    let left = 0;
    const bars = share.map((part, k) => {
      const bar = shape("rect", {x: left, y: 4, width: Math.max(Math.min(300 * part, 400), 0), height: 24, class: ["kinetic", "potential", "compression"][k]});
      left += 300 * part;
      return bar;
    });
    const most = Math.max(1.1, ...state.curve.map(([, total]) => Math.min(total, 4))), last = Math.max(0.5, state.liquid.time);
    const at = ([time, total]) => `${(390 * time / last).toFixed(1)} ${(145 - 90 * Math.min(total, most) / most).toFixed(1)}`;
    const line = level => shape("path", {class: "guide", d: `M${at([0, level])}L${at([last, level])}`});
    meter.replaceChildren(...bars, shape("path", {class: "guide", d: "M300 0V32"}), line(0), line(1),
      shape("path", {class: "total", d: `M${state.curve.map(at).join("L")}`}),
      shape("text", {x: 2, y: 45}, "energy in time"), shape("text", {x: 304, y: 45}, "100 %"));
    const percent = value => `${(100 * value).toFixed(1)} %`;
    clock.textContent = `${state.liquid.time.toFixed(2)} s. Energy over that at the start: ${percent(sum(share))} = ${percent(share[0])} kinetic `
      + `+ ${percent(share[1])} potential + ${percent(share[2])} of compression. Momentum ${px.toFixed(2)}, ${py.toFixed(2)} kg/(m s).`;
  }

  function begin() {
    const liquid = Liquid.create({...page.start, ...state.settings});
    Object.assign(state, {liquid, curve: [], begun: sum(Liquid.energy(liquid))});
    state.chosen = Math.min(state.chosen || Math.floor(liquid.n / 2 + liquid.columns / 2), liquid.n - 1);
    draw();
  }

  function advance(steps) {
    const {liquid} = state;
    if (sum(Liquid.energy(liquid)) < 100 * state.begun) Liquid.advance(liquid, steps);
    else if (state.running) play();
    draw();
  }

  const button = (words, act) => { const made = element("button", {type: "button"}, words); made.addEventListener("click", act); return made; };
  const starts = button("Start", play);
  function play() {
    if (still()) { advance(200); return; }
    state.running = !state.running;
    starts.textContent = state.running ? "Stop" : "Start";
    if (state.running) requestAnimationFrame(frame);
  }
  function frame() {
    const until = performance.now() + 12;
    if (!state.running) return;
    do Liquid.advance(state.liquid, 1); while (performance.now() < until);
    advance(1);
    requestAnimationFrame(frame);
  }

  // The particle nearest to a place [m].
  function choose([px, py]) {
    const {x, n} = state.liquid, far = Array.from({length: n}, (_, k) => Math.hypot(x[2 * k] - px, x[2 * k + 1] - py));
    state.chosen = far.indexOf(Math.min(...far));
    draw();
  }
  function pointed(event) {
    const {left, top, width} = canvas.getBoundingClientRect(), scale = (RIGHT - LEFT) / width;
    choose([LEFT + scale * (event.clientX - left), TOP - scale * (event.clientY - top)]);
  }
  for (const kind of ["pointerdown", "pointermove"]) canvas.addEventListener(kind, pointed);
  canvas.addEventListener("keydown", event => {
    const {x, spacing} = state.liquid, k = 2 * state.chosen;
    const step = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1]}[event.key];
    const act = step ? () => choose([x[k] + 1.1 * spacing * step[0], x[k + 1] + 1.1 * spacing * step[1]])
      : {" ": play, Enter: () => advance(10)}[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  });

  const set = name => value => { state.settings[name] = value; begin(); };
  const metres = digits => value => `${value.toFixed(digits)} m`;
  const CONTROLS = {
    spacing: () => Live.slider("spacing", "spacing d", Object.keys(SPACINGS).map(Number).sort((a, b) => b - a), 0.05, metres(3), value => {
      [state.settings.columns, state.settings.rows] = SPACINGS[value];
      set("spacing")(value);
    }).row,
    ratio: () => Live.slider("ratio", "support h/d", [2, 2.3, 2.6, 2.9, 3.2], 2.6, value => value.toFixed(1), set("ratio")).row,
    kernel: () => Live.choice("kernel", "kernel W", Object.fromEntries(Object.keys(Liquid.KERNELS).map(name => [name, name])), set("kernel")),
    viscosity: () => Live.slider("viscosity", "viscosity α", [0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2],
      page.start.viscosity ?? Liquid.DEFAULT.viscosity, String, set("viscosity")).row,
    step: () => Live.slider("step", "step over 0.2 h/c", [0.5, 1, 1.5, 2, 2.5, 3, 4, 5, 6], 1, String, set("step")).row,
    walls: () => Live.choice("walls", "a wall pushes with", {own: "its own pressure", particle: "that of the particle", none: "no walls"}, set("walls")),
    form: () => Live.choice("form", "pressure force", {symmetric: "p_i/ρ_i² + p_j/ρ_j²", plain: "p_j/(ρ_i ρ_j)"}, set("form")),
    jitter: () => Live.slider("jitter", "jitter", [0, 0.1, 0.2], page.start.jitter ?? 0, value => `${value.toFixed(1)} d`, set("jitter")).row,
  };
  const keys = element("p", {class: "keys"}, ...["kinetic", "potential", "compression"].map(kind => element("span", {class: kind}, kind)));
  box.replaceChildren(
    element("div", {class: "controls"}, element("p", {}, starts, button("Ten steps", () => advance(10)), button("From the start", begin)),
      ...page.controls.map(name => CONTROLS[name]())),
    element("div", {class: "drawings"}, canvas, element("div", {}, ...(page.energy ? [meter, keys, clock] : []), said)));
  document.getElementById("asked").replaceChildren(Live.questions(page.questions));
  begin();
  return {state, around, advance, begin};
})();
