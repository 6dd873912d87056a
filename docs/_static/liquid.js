// SPH in the page: the program sph_by_hand.py, statement by statement, on a canvas. SI units, in the plane per metre of depth.
const Liquid = (() => {
  const LAYERS = 3, TANK = [2, 1.5];  // of walls; width and height of the box [m]
  const DENSITY = 1000, SOUND = 40, GRAVITY = 9.81;  // at rest [kg/m^3], [m/s], [m/s^2]

  // h^2 W and h^4 (dW/dr)/r of q = r/h < 1, in the plane.
  const KERNELS = {
    "Wendland C2": {value: q => 7 / Math.PI * (1 - q) ** 4 * (4 * q + 1), slope: q => -140 / Math.PI * (1 - q) ** 3},
    "cubic spline": {
      value: q => 40 / (7 * Math.PI) * (q < 0.5 ? 1 - 6 * q * q * (1 - q) : 2 * (1 - q) ** 3),
      slope: q => 40 / (7 * Math.PI) * (q < 0.5 ? 18 * q - 12 : -6 * (1 - q) ** 2 / q),
    },
    spiky: {value: q => 10 / Math.PI * (1 - q) ** 3, slope: q => -30 / Math.PI * (1 - q) ** 2 / q},
  };
  const DEFAULT = {
    spacing: 0.05,  // d [m]
    ratio: 2.6,  // h/d, h is the support radius
    kernel: "Wendland C2",
    viscosity: 0.05,  // alpha of Monaghan's artificial viscosity [-]
    step: 1,  // over 0.2 h/c
    walls: "own",  // whose pressure a wall has: its own, "particle" (that of whom it pushes), or "none": no walls
    form: "symmetric",  // of the pressure's gradient; "plain": p_j/(rho_i rho_j)
    gravity: true,
    columns: 10, rows: 20, left: 0, bottom: 0,  // of the liquid, in spacings
    jitter: 0,  // places at the start are moved by up to so many spacings along both axes
  };

  // Places [m] of layers of particles below and beside the box.
  function wallParticles({spacing: d}) {
    const [wide, high] = TANK.map(edge => Math.round(edge / d)), places = [];
    for (let j = -LAYERS; j < high; j++)
      for (let i = -LAYERS; i < wide + LAYERS; i++)
        if (i < 0 || j < 0 || i >= wide) places.push(d * (i + 0.5), d * (j + 0.5));
    return places;
  }

  // A liquid at its start: x, v hold its n particles and then those of the walls, two numbers each.
  function create(settings = {}) {
    const s = {...DEFAULT, ...settings}, d = s.spacing, draw = Live.random(1), places = [];
    const at = k => d * (k + 0.5 + s.jitter * (2 * draw() - 1));
    for (let j = 0; j < s.rows; j++) for (let i = 0; i < s.columns; i++) places.push(at(i + s.left), at(j + s.bottom));
    const n = places.length / 2, walls = s.walls === "none" ? [] : wallParticles(s), h = s.ratio * d;
    const x = Float64Array.from([...places, ...walls]);
    const liquid = {...s, h, n, x, v: new Float64Array(x.length), mass: DENSITY * d * d, time: 0,
      dt: s.step * 0.2 * h / SOUND};
    const alone = liquid.mass * weight(liquid, 0), solid = Float64Array.from(walls), all = solid.length / 2;
    const among = density({...liquid, x: solid, rest: new Float64Array(all).fill(alone)}, pairs({x: solid, n: all, h}));
    return {...liquid, rest: Float64Array.from([...new Array(n).fill(alone), ...among])};
  }

  const weight = ({kernel, h}, r) => (r < h ? KERNELS[kernel].value(r / h) / h ** 2 : 0);
  const slope = ({kernel, h}, r) => (r < h ? KERNELS[kernel].slope(r / h) / h ** 4 : 0);  // times the vector: grad W

  // Pairs nearer than h of which the first is one of the n first particles: i < j, distance r and vector from j to i [m].
  function pairs({x, n, h}) {
    const all = x.length / 2, columns = Math.ceil((TANK[0] + 2) / h), rows = Math.ceil((TANK[1] + 2) / h);
    const cell = (value, most) => Math.min(Math.max(Math.floor((value + 1) / h), 0), most - 1);  // outside: those of the rim
    const first = new Int32Array(columns * rows).fill(-1), next = new Int32Array(all);
    const [i, j, r, dx, dy] = [[], [], [], [], []];
    for (let a = all - 1; a >= 0; a--) {
      const c = cell(x[2 * a], columns), e = cell(x[2 * a + 1], rows);
      if (a < n)
        for (let row = Math.max(e - 1, 0); row <= Math.min(e + 1, rows - 1); row++)
          for (let column = Math.max(c - 1, 0); column <= Math.min(c + 1, columns - 1); column++)
            for (let b = first[row * columns + column]; b >= 0; b = next[b]) {
              const across = x[2 * a] - x[2 * b], up = x[2 * a + 1] - x[2 * b + 1], far = Math.hypot(across, up);
              if (far < h) { i.push(a); j.push(b); r.push(far); dx.push(across); dy.push(up); }
            }
      next[a] = first[e * columns + c];
      first[e * columns + c] = a;
    }
    return {count: i.length, i, j, r, dx, dy};
  }

  // Smoothed sums of masses [kg/m^3], of walls as well.
  function density(liquid, near) {
    const total = new Float64Array(liquid.x.length / 2);
    const {value} = KERNELS[liquid.kernel], {i, j, r, count} = near;
    for (let k = 0; k < count; k++) {
      const one = value(r[k] / liquid.h) / liquid.h ** 2;
      total[i[k]] += one;
      total[j[k]] += one;
    }
    return total.map((sum, k) => liquid.rest[k] + liquid.mass * sum);
  }

  const pressure = rho => Math.max(SOUND ** 2 * (rho - DENSITY), 0);  // [Pa]

  // What pressure, viscosity and gravity do to the liquid [m/s^2].
  function acceleration(liquid) {
    const {n, x, v, h, mass, form, walls, viscosity} = liquid, near = pairs(liquid), rho = density(liquid, near);
    const gradient = KERNELS[liquid.kernel].slope, p = rho.map(pressure), a = new Float64Array(2 * n);
    for (let k = 0; k < near.count; k++) {
      const i = near.i[k], j = near.j[k], dx = near.dx[k], dy = near.dy[k], wall = j >= n;
      const approach = Math.min((v[2 * i] - v[2 * j]) * dx + (v[2 * i + 1] - v[2 * j + 1]) * dy, 0);
      const damping = -viscosity * SOUND * h * approach / (near.r[k] ** 2 + 0.01 * h * h) / (0.5 * (rho[i] + rho[j]));
      const other = wall && walls === "particle" ? i : j;  // whose pressure and density
      const both = p[i] / rho[i] ** 2 + p[other] / rho[other] ** 2;
      const push = form === "plain" ? p[other] / (rho[i] * rho[other]) : both;
      const back = form === "plain" ? p[i] / (rho[i] * rho[j]) : both;
      const grad = -mass * gradient(near.r[k] / h) / h ** 4;
      a[2 * i] += (push + damping) * grad * dx;
      a[2 * i + 1] += (push + damping) * grad * dy;
      if (wall) continue;
      a[2 * j] -= (back + damping) * grad * dx;
      a[2 * j + 1] -= (back + damping) * grad * dy;
    }
    if (liquid.gravity) for (let k = 0; k < n; k++) a[2 * k + 1] -= GRAVITY;
    return a;
  }

  function advance(liquid, steps = 1) {
    const {n, x, v, dt} = liquid;
    for (let step = 0; step < steps; step++) {
      for (let k = 0; k < 2 * n; k++) x[k] += 0.5 * dt * v[k];
      const a = acceleration(liquid);
      for (let k = 0; k < 2 * n; k++) { v[k] += dt * a[k]; x[k] += 0.5 * dt * v[k]; }
      liquid.time += dt;
    }
    return liquid;
  }

  // [kinetic, potential, compression] energy [J/m]; the last is the integral of p/rho^2 over the density.
  function energy(liquid) {
    const {n, x, v, mass} = liquid, rho = density(liquid, pairs(liquid));
    let [moving, high, pressed] = [0, 0, 0];
    for (let k = 0; k < n; k++) {
      moving += (v[2 * k] ** 2 + v[2 * k + 1] ** 2) / 2;
      high += liquid.gravity ? GRAVITY * x[2 * k + 1] : 0;
    }
    for (const one of rho) { const s = Math.max(one / DENSITY, 1); pressed += SOUND ** 2 * (Math.log(s) + 1 / s - 1); }
    return [mass * moving, mass * high, mass * pressed];
  }

  function momentum({n, v, mass}) {
    const total = [0, 0];
    for (let k = 0; k < 2 * n; k++) total[k % 2] += mass * v[k];
    return total;
  }

  return {KERNELS, DEFAULT, TANK, DENSITY, SOUND, create, pairs, density, acceleration, advance, energy, momentum, weight, slope};
})();
