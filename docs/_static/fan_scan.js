// Lesson 1: which particles are surface, and why. Particles follow the pointer or the arrow keys.
const FanScan = (() => {
  const {element, shape, drawing, kernel, slope} = Live;
  const [COLUMNS, ROWS] = [9, 6];
  const D = 0.01, H = 2.6 * D, S = H / 2;  // spacing, support radius and radius of the scan [m]
  const [WIDTH, HEIGHT] = [13 * D, 10 * D];  // of the drawing [m], the block's lower left corner at (2 D, 1 D)
  const PER_METRE = 400 / WIDTH;
  const SPARSE = 0.9, LOPSIDED = 0.25;  // limits of the first step
  const REST = rest();
  const PLANE = REST * H / (3 * Math.PI);  // first moment of a particle on a plane surface [1/m]
  const state = {points: [], chosen: 0};

  // Number density of the undisturbed lattice [1/m^2].
  function rest() {
    let total = 0;
    for (let i = -3; i <= 3; i++) for (let j = -3; j <= 3; j++) total += kernel(D * Math.hypot(i, j), H);
    return total;
  }

  // What the fan holds [m]: a cone of 90 degrees up to sqrt(2) s, and beyond it a ball of radius s around x_i + s a.
  function inFan(away, axis) {
    const squared = away[0] ** 2 + away[1] ** 2, along = away[0] * axis[0] + away[1] * axis[1];
    if (squared >= 2 * S * S) return squared < 2 * S * along;
    return along > 0 && 2 * along ** 2 > squared;
  }

  // For each particle: number density and one-sidedness (shares), neighbours, axis, who stands in its fan, verdict.
  function detected(points) {
    const found = points.map(([x, y]) => {
      let density = 0, mx = 0, my = 0, near = -1;  // a particle is no neighbour of itself
      for (const [px, py] of points) {
        const r = Math.hypot(x - px, y - py), w = kernel(r, H);
        density += w;
        mx += w * (x - px);
        my += w * (y - py);
        near += r < H;
      }
      const share = density / REST, moment = Math.hypot(mx, my) / PLANE;
      return {share, moment, near, scanned: share <= SPARSE || moment >= LOPSIDED, axis: null, inside: [], surface: false};
    });
    points.forEach((at, i) => {
      const one = found[i];
      if (!one.scanned) return;
      const inward = [0, 0];
      points.forEach((other, j) => {
        const away = [other[0] - at[0], other[1] - at[1]], r = Math.hypot(...away);
        if (r === 0 || r >= H) return;
        for (const c of [0, 1]) inward[c] -= H / (found[j].share * REST) * slope(r, H) * away[c] / r;
      });
      const length = Math.hypot(...inward);
      if (length > 1e-12) {
        one.axis = inward.map(c => -c / length);
        one.inside = points.flatMap((other, j) =>
          j !== i && inFan([other[0] - at[0], other[1] - at[1]], one.axis) ? [j] : []);
      }
      one.surface = one.near < 3 || (one.axis !== null && one.inside.length === 0);
    });
    return found;
  }

  function why(one, i) {
    const few = one.share <= SPARSE ? "few neighbours (at most 0.90)" : "enough neighbours (more than 0.90)";
    const sided = one.moment >= LOPSIDED ? "stand on one side (at least 0.25)" : "stand all around (less than 0.25)";
    const first = `Particle ${i + 1}. First step: number density ${one.share.toFixed(3)} δ₀, ${few}; one-sidedness `
      + `${one.moment.toFixed(3)}, they ${sided}`;
    if (!one.scanned) return `${first}. It is not scanned, and not surface.`;
    if (one.near < 3) return `${first}: it is scanned. It has fewer than 3 neighbours: surface.`;
    if (one.axis === null) return `${first}: it is scanned. Its neighbours give no outward direction: not surface.`;
    if (one.inside.length === 0) return `${first}: it is scanned. Second step: its fan is empty: surface.`;
    const those = one.inside.length === 1 ? "stands particle" : "stand particles";
    const numbers = one.inside.map(j => j + 1).join(", ");
    return `${first}: it is scanned. Second step: in its fan ${those} ${numbers}: not surface.`;
  }

  const block = () => Array.from({length: COLUMNS * ROWS}, (_, k) =>
    [(2.5 + k % COLUMNS) * D, (1.5 + Math.floor(k / COLUMNS)) * D]);

  const ARRANGED = {
    "Undisturbed": block,
    "Shaken": () => {
      const draw = Live.random(7);
      return block().map(at => at.map(c => c + 0.3 * D * (2 * draw() - 1)));
    },
    "Splash": () => block().map(([x, y], k) => {
      if (k < 36) return [x, y];
      if (k < 45) return [x + 0.35 * (y - 4 * D), y + 0.2 * D];
      return [(2.1 + 0.55 * (k - 45)) * D + 0.8 * (x - 2.5 * D) / 2, y + 1.2 * D + 0.25 * D * Math.sin(k)];
    }),
  };

  const QUESTIONS = [
    {
      asks: "How many particles of the undisturbed block of 9 × 6 are surface?",
      unit: "particles",
      right: [[26, 26, "They are the outermost layer: 2 · (9 + 6) − 4."]],
      wrong: [
        [30, 30, "The corners are counted twice."],
        [22, 22, "The corners are missing: their fans are empty too."],
        [28, 28, "Those are the particles inside, 7 · 4."],
        [54, 54, "Those are all particles. Inside, neighbours stand all around."],
      ],
      hint: "Press Undisturbed and count the particles of the surface's colour.",
    },
    {
      asks: "How wide is the fan's opening near its particle, in degrees?",
      unit: "°",
      right: [[90, 90, "45° to either side of the outward direction."]],
      wrong: [
        [45, 45, "That is the angle between the outward direction and one side of the fan."],
        [180, 180, "That is a half plane: the neighbours in a bent surface would stand in it."],
        [360, 360, "The fan looks outward only; a full circle always holds neighbours."],
      ],
      hint: "Choose a particle of the surface and look at the fan.",
    },
    {
      asks: "Undisturbed: lift particle 50, in the middle of the top row, by the arrow key. Particle 49 beside it stops being surface, and is surface again once particle 50 is how many spacings above its old place?",
      unit: "spacings",
      right: [[2.3, 2.5, "Particle 50 has left the fan of particle 49, which leans towards the gap."]],
      wrong: [
        [0.7, 1.1, "That is where particle 50 enters the fan of particle 49. Lift it out again."],
        [1.2, 1.4, "That is the radius s of the scan; the fan is as long as 2 s."],
        [1.7, 1.9, "That is √2 s, where the straight sides of the fan end. Beyond them it is round."],
        [2.55, 2.65, "The fan is that long straight ahead, 2 s = h. Particle 50 stands to its side and leaves it sooner."],
        [2.9, 3.1, "It is surface already before. Press the key once at a time: a tenth of a spacing."],
      ],
      hint: "Choose particle 50, press the arrow key in the picture, then choose particle 49 and look at its fan.",
    },
  ];

  function start(box) {
    const picture = drawing(400, HEIGHT * PER_METRE, "Particles, and the fan of the chosen one. Arrow keys move it.");
    picture.setAttribute("tabindex", 0);
    picture.setAttribute("role", "application");
    picture.classList.add("moved");
    const said = element("p", {class: "said", "aria-live": "polite"});
    const count = element("p", {class: "count"});
    const numbers = Array.from({length: COLUMNS * ROWS}, (_, k) => k);
    const chosen = Live.slider("chosen", "particle", numbers, 0, k => `${k + 1}`, k => { state.chosen = k; draw(); });
    const buttons = Object.entries(ARRANGED).map(([name, arranged]) => {
      const button = element("button", {type: "button"}, name);
      button.addEventListener("click", () => { state.points = arranged(); draw(); });
      return button;
    });
    const map = Live.map(0, HEIGHT, PER_METRE), {column, row} = map;

    function fan(at, axis) {
      const corner = turn => [0, 1].map(c => at[c] + S * (axis[c] + turn * (c ? axis[0] : -axis[1])));
      const [[ax, ay], [bx, by]] = [corner(1), corner(-1)];
      const radius = S * PER_METRE;
      return shape("path", {class: "fan", d: `M${column(at[0])} ${row(at[1])}L${column(ax)} ${row(ay)}`
        + `A${radius} ${radius} 0 0 1 ${column(bx)} ${row(by)}Z`});
    }

    function draw() {
      const found = detected(state.points), one = found[state.chosen], at = state.points[state.chosen];
      const dots = state.points.map((place, k) => {
        const kind = found[k].surface ? "surface" : found[k].scanned ? "scanned" : "inner";
        const seen = one.inside.includes(k) ? " seen" : k === state.chosen ? " chosen" : "";
        return map.circle(place, 0.4 * D, kind + seen);
      });
      picture.replaceChildren(...(one.axis ? [fan(at, one.axis)] : []), ...dots, map.circle(at, H, "support"));
      said.textContent = why(one, state.chosen);
      const surface = found.filter(({surface}) => surface).length, scanned = found.filter(({scanned}) => scanned).length;
      count.textContent = `${surface} of ${found.length} particles are surface; ${scanned} are scanned.`;
    }

    function move(x, y) {
      const within = (value, most) => Math.min(Math.max(value, 0), most);
      state.points[state.chosen] = [within(x, WIDTH), within(y, HEIGHT)];
      draw();
    }

    let offset = [0, 0];  // from the pointer to the particle's centre [m]
    function choose([x, y]) {
      const far = state.points.map(([px, py]) => Math.hypot(px - x, py - y)), nearest = Math.min(...far);
      if (nearest > 0.7 * D) return false;
      state.chosen = far.indexOf(nearest);
      offset = [state.points[state.chosen][0] - x, state.points[state.chosen][1] - y];
      chosen.set(state.chosen);
      draw();
      return true;
    }
    Live.follow(picture, map, choose, ([x, y]) => move(x + offset[0], y + offset[1]));
    picture.addEventListener("keydown", event => {
      const step = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1]}[event.key];
      if (!step) return;
      event.preventDefault();
      const [x, y] = state.points[state.chosen];
      move(x + 0.1 * D * step[0], y + 0.1 * D * step[1]);
    });

    const keys = element("p", {class: "keys"}, ...[["surface", "surface"], ["scanned", "scanned, no surface"],
      ["inner", "not scanned"], ["seen", "in the fan"]].map(([kind, words]) => element("span", {class: kind}, words)));
    box.replaceChildren(element("div", {class: "controls"}, element("p", {}, ...buttons), chosen.row),
      element("div", {class: "drawings"}, picture, element("div", {}, count, said, keys)));
    document.getElementById("asked").replaceChildren(Live.questions(QUESTIONS));
    state.points = block();
    state.chosen = numbers.length - 5;
    chosen.set(state.chosen);
    draw();
  }

  start(document.getElementById("fan-scan"));
  return {state, detected, QUESTIONS, REST, PLANE};
})();
