// Lesson 0: a plate of particles, the smoothed sum along its middle, and the error of the sum.
const SmoothedSum = (() => {
  const {element, shape, drawing, kernel} = Live;
  const [LEFT, RIGHT, MIDDLE] = [-0.2, 1.2, 0.5];  // m
  const SIDE = 400;  // units of a drawing
  const PER_METRE = SIDE / (RIGHT - LEFT);
  const steps = (first, last, step) =>
    Array.from({length: Math.round((last - first) / step) + 1}, (_, k) => Number((first + k * step).toFixed(4)));
  const FIELDS = {ones: () => 1, wave: x => Math.sin(2 * Math.PI * x)};
  const state = {h: 0.13, d: 0.05, jitter: 0, field: "ones", x: 0.5};

  // Centres of the particles [m], rows of [x, y], each moved by up to jitter d along both axes.
  function particles() {
    const n = Math.round(1 / state.d), draw = Live.random(1), found = [];
    const at = k => (k + 0.5 + state.jitter * (2 * draw() - 1)) * state.d;
    for (let j = 0; j < n; j++) for (let i = 0; i < n; i++) found.push([at(i), at(j)]);
    return found;
  }

  // S = sum_j d^2 f_j W(|x - x_j|, h) at (x, MIDDLE), and how many particles are nearer than h.
  function sum(points, x) {
    let total = 0, near = 0;
    for (const [px, py] of points) {
      const r = Math.hypot(x - px, MIDDLE - py);
      if (r >= state.h) continue;
      total += state.d ** 2 * FIELDS[state.field](px) * kernel(r, state.h);
      near += 1;
    }
    return {total, near};
  }

  const QUESTIONS = [
    {
      asks: "A neighbour stands at the distance h/2. How large is its weight, as a share of that at the distance 0: W(h/2)/W(0) = ?",
      right: [[0.185, 0.19, "(1/2)⁴ · (1 + 4/2) = 3/16. Half way out, a neighbour counts less than a fifth."]],
      wrong: [
        [0.49, 0.51, "The weight does not fall along a straight line: put q = 1/2 into (1 − q)⁴ (1 + 4q)."],
        [0.06, 0.065, "The factor 1 + 4q is missing: with q = 1/2 it is 3."],
        [2.99, 3.01, "The power of 1 − q is missing: (1/2)⁴ = 1/16, not 1."],
        [5.3, 5.4, "This is upside down, W(0)/W(h/2)."],
      ],
      hint: "Put q = 1/2 into (1 − q)⁴ (1 + 4q), and divide by its value at q = 0.",
    },
    {
      asks: "Ones, d = 0.05 m, h = 0.13 m, no jitter: what is the sum in the middle of the left edge, at x = 0?",
      right: [[0.48, 0.52, "Half of the disc is empty. The density of SPH drops at a free surface in the same way; lesson 1 finds surface particles by it."]],
      wrong: [
        [0.9, 1.1, "Beyond the edge are no particles: half of the disc is empty."],
        [-0.05, 0.05, "Half of the disc is full of particles."],
        [0.2, 0.3, "That is a corner of the plate, where a quarter of the disc is full."],
      ],
      hint: "Move the point x to 0 and look at the part of the disc that holds particles.",
    },
    {
      asks: "h = 0.13 m stays and d is halved, from 0.05 m to 0.025 m. 24 particles were within h of the middle of the plate. How many are now?",
      unit: "particles",
      right: [[80, 100, "Four times as many, 88 if counted: the disc is the same, and each particle has a quarter of the area."]],
      wrong: [
        [40, 56, "That is twice as many. Spacings are halved along x and along y."],
        [18, 30, "The disc is the same, but the particles are smaller."],
        [4, 8, "This is upside down: smaller particles, more of them."],
        [150, 220, "That is eight times as many, as in space. In the plane a particle has the area d²."],
      ],
      hint: "Which area has a particle? Divide the area of the disc by it.",
    },
    {
      asks: "Wave, d = 0.025 m, no jitter. At its top, x = 0.25 m, the sum with h = 0.24 m gives 0.924: the error is −0.076. With which h [m] is a quarter of the error left, 20 to 30 % of it?",
      unit: "m",
      right: [
        [0.104, 0.129, "The error goes with h²: half the width, a quarter of the error."],
        [0.0551, 0.0618, "A quarter is left. At h = 0.12 m it is, too: at 0.06 m so few particles lie within h that another error grows."],
      ],
      wrong: [
        [0.0001, 0.0551, "So few particles lie within h that another error grows."],
        [0.0619, 0.104, "Less than 20 % of the error is left."],
        [0.23, 0.25, "That is the same h, and the same error."],
        [0.13, 0.23, "More than 30 % of the error is left: h must be smaller."],
        [0.26, 1, "A wider kernel smooths more."],
      ],
      hint: "Move h and watch the error at x = 0.25 m.",
    },
  ];

  function start(box) {
    const plate = drawing(SIDE, SIDE, "The plate of particles, and the disc of radius h around the point x");
    const curve = drawing(SIDE, SIDE, "Above: the sum and the exact field along the middle of the plate. Below: the error");
    const said = element("p", {class: "said", "aria-live": "polite"});
    const change = name => value => { state[name] = value; draw(); };
    const metres = digits => value => `${value.toFixed(digits)} m`;
    const x = Live.slider("x", "point x", steps(LEFT, RIGHT, 0.01), state.x, metres(2), change("x"));
    const controls = element("div", {class: "controls"},
      Live.choice("field", "field f", {ones: "ones", wave: "wave, sin 2πx"}, change("field")),
      Live.slider("h", "support radius h", steps(0.06, 0.26, 0.01), state.h, metres(2), change("h")).row,
      Live.slider("d", "spacing d", [0.1, 0.05, 0.04, 0.025, 0.02], state.d, metres(3), change("d")).row,
      Live.slider("jitter", "jitter", steps(0, 0.5, 0.05), 0, value => `${value.toFixed(2)} d`, change("jitter")).row,
      x.row);

    const map = Live.map(LEFT, RIGHT, PER_METRE), {column, row} = map;

    function drawPlate(points) {
      const dots = points.map(([px, py]) => {
        const share = kernel(Math.hypot(state.x - px, MIDDLE - py), state.h) / kernel(0, state.h);
        const dot = map.circle([px, py], 0.42 * state.d, "particle");
        if (share > 0) dot.append(shape("title", {}, `weight ${share.toFixed(3)} of W(0)`));
        dot.style.setProperty("--share", Math.sqrt(share));
        return dot;
      });
      const disc = map.circle([state.x, MIDDLE], state.h, "support");
      const point = map.circle([state.x, MIDDLE], 0.014, "point");
      const line = shape("path", {d: `M0 ${row(MIDDLE)}H${SIDE}`, class: "guide"});
      const edge = shape("rect", {x: column(0), y: row(1), width: PER_METRE, height: PER_METRE, class: "guide"});
      plate.replaceChildren(edge, ...dots, line, disc, point);
    }

    // A curve within rows top to bottom of the drawing, with the values `low` to `high` along its left side.
    function panel(top, bottom, low, high, words, curves) {
      const down = value => bottom - (value - low) / (high - low) * (bottom - top);
      const made = [shape("text", {x: 4, y: top - 6}, words)];
      for (const value of [low, 0, high].filter((value, k, all) => all.indexOf(value) === k)) {
        made.push(shape("path", {d: `M0 ${down(value)}H${SIDE}`, class: "guide"}));
        made.push(shape("text", {x: SIDE - 4, y: down(value) - 3, "text-anchor": "end"}, Number(value.toPrecision(2)).toString()));
      }
      for (const [name, points] of curves) {
        const path = points.map(([px, value], k) => `${k ? "L" : "M"}${column(px).toFixed(1)} ${down(value).toFixed(1)}`);
        made.push(shape("path", {d: path.join(""), class: name}));
      }
      made.push(shape("path", {d: `M${column(state.x)} ${top}V${bottom}`, class: "here"}));
      return made;
    }

    function drawCurve(points) {
      const along = steps(LEFT, RIGHT, 0.01).map(px => [px, sum(points, px).total]);
      const exact = steps(0, 1, 0.01).map(px => [px, FIELDS[state.field](px)]);
      const error = along.filter(([px]) => px >= 0 && px <= 1).map(([px, total]) => [px, total - FIELDS[state.field](px)]);
      const largest = Math.max(...error.map(([, value]) => Math.abs(value)), 1e-3);
      const top = Math.max(1.1, ...along.map(([, value]) => value));
      curve.replaceChildren(
        ...panel(26, 205, state.field === "ones" ? 0 : -top, top, "sum S (solid), field f (dashed)",
          [["exact", exact], ["total", along]]),
        ...panel(245, 375, -largest, largest, "error S − f", [["total", error]]),
        ...[0, 0.25, 0.5, 0.75, 1].map(px =>
          shape("text", {x: column(px), y: 394, "text-anchor": "middle"}, px === 1 ? "x = 1 m" : `${px}`)));
    }

    function draw() {
      const points = particles(), {total, near} = sum(points, state.x), exact = FIELDS[state.field](state.x);
      drawPlate(points);
      drawCurve(points);
      const compared = state.x < 0 || state.x > 1 ? "the point is off the plate"
        : `f = ${exact.toFixed(5)}, error S − f = ${(total - exact).toFixed(5)}`;
      said.textContent = `At x = ${state.x.toFixed(2)} m: S = ${total.toFixed(5)}, ${compared}; `
        + `${near} of ${points.length} particles are within h.`;
    }

    function move([at]) {
      state.x = Number(Math.min(Math.max(at, LEFT), RIGHT).toFixed(2));
      x.set(state.x);
      draw();
      return true;
    }
    for (const svg of [plate, curve]) Live.follow(svg, map, move, move);
    box.replaceChildren(controls, said, element("div", {class: "drawings"}, plate, curve));
    document.getElementById("asked").replaceChildren(Live.questions(QUESTIONS));
    draw();
  }

  start(document.getElementById("smoothed-sum"));
  return {state, particles, QUESTIONS};
})();
