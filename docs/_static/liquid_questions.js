// Of each page with a liquid: its view, its start, its switches and its questions. [least, largest, sentence] as in live.js.
const PAGES = (() => {
  const view = [0.5, 1.5, 0.2, 1.2];  // of the canvas [m]
  const block = {walls: "none", gravity: false, columns: 14, rows: 14, left: 13, bottom: 7};
  return {
    sum: {
      colour: "density", view, start: block, controls: ["ratio", "kernel", "jitter"],
      questions: [
        {
          asks: "A particle inside: the arrows are its neighbours' terms V ∇W. How long is their sum, in 1/m?",
          right: [[-0.05, 0.05, "For each neighbour another stands opposite: the terms cancel. The gradient of a constant is zero."]],
          wrong: [[9, 9.1, "That is a particle of the edge. Choose one inside."]],
          hint: "Choose a particle in the middle and read the sum of V ∇W.",
        },
        {
          asks: "Inside, h/d = 2.6: which share of the sum of V W comes from the particle itself, V W(0)? d = 0.05 m, W(0) = 7/(π h²).",
          right: [[0.32, 0.335, "7/(2.6² π) = 0.33, of 1.01. With a wider support it is less: the sum becomes an integral."]],
          wrong: [
            [0.04, 0.055, "A particle is one of 21, but it stands at the top of the hill."],
            [2.2, 2.3, "That is 7/π. V = d², and h = 2.6 d."],
            [0.84, 0.87, "h is squared."],
          ],
          hint: "V W(0) = d² · 7/(π h²).",
        },
        {
          asks: "Kernel spiky: by how much does the sum of V W inside exceed 1, in %?",
          unit: "%",
          right: [[11.8, 12.6, "The spiky kernel is pointed at its middle, where one particle stands for a whole area. The cubic spline gives 1.000, Wendland's 1.011."]],
          wrong: [[110, 120, "That is the sum itself. By how much is it above 1?"], [0.8, 1.4, "That is Wendland's kernel."]],
          hint: "Choose the kernel, a particle inside, and read the sum of V W.",
        },
      ],
    },
    surface: {
      colour: "density", view, start: block, controls: ["ratio", "jitter"],
      questions: [
        {
          asks: "h/d = 2.6: what is the sum of V W in the middle of an edge?",
          right: [[0.785, 0.805, "More than one half: the particle itself counts 0.33 and stands on the edge's inner side, half a spacing from it."]],
          wrong: [
            [0.45, 0.55, "So it is for a point on the edge itself. The particle stands half a spacing inside."],
            [0.99, 1.02, "That is inside."],
            [0.61, 0.64, "That is a corner."],
          ],
          hint: "Choose a particle in the middle of a side.",
        },
        {
          asks: "And in a corner?",
          right: [[0.615, 0.635, "Two sides are missing."]],
          wrong: [[0.2, 0.3, "A point at the corner has a quarter. The particle stands half a spacing inside along both axes."], [0.78, 0.81, "That is the middle of an edge."]],
          hint: "Choose the particle in a corner.",
        },
        {
          asks: "Take h/d = 3.2: the sum in the middle of an edge becomes what?",
          right: [[0.725, 0.745, "It goes towards one half. A wider support does not mend it, because the missing half stays missing."]],
          wrong: [[0.99, 1.02, "That is inside."], [0.85, 0.95, "That is a narrower support, h/d = 2."]],
          hint: "Move h/d, and choose the particle in the middle of a side again.",
        },
        {
          asks: "p = c² (ρ − ρ₀) with c = 40 m/s: what pressure would the edge have with h/d = 2.6, in kPa?",
          unit: "kPa",
          right: [[-345, -315, "1600 · (794 − 1000): a tension that pulls the edge inwards. The program sets it to zero."]],
          wrong: [
            [315, 345, "The density is too small: the pressure is negative."],
            [-9, -7, "c is squared."],
            [-0.35, -0.3, "ρ₀ is 1000 kg/m³."],
          ],
          hint: "ρ is 0.794 of 1000 kg/m³.",
        },
      ],
    },
    pressure: {
      colour: "density", energy: true, view: [0.2, 1.8, 0.1, 1.3], start: {...block, jitter: 0.2, viscosity: 0}, controls: ["form", "viscosity", "jitter"],
      questions: [
        {
          asks: "Two particles, p_i = 3 kPa, p_j = 1 kPa, both of 1000 kg/m³. Plain form: how large is the force on i over that on j?",
          right: [[0.33, 0.34, "i feels p_j and j feels p_i: 1 to 3. They do not push each other alike, and the pair as a whole is accelerated from nothing."]],
          wrong: [[2.9, 3.1, "i feels the pressure of j, not its own."], [0.99, 1.01, "That is the symmetric form."]],
          hint: "In the plain form i has p_j/(ρ_i ρ_j), and j has p_i/(ρ_i ρ_j).",
        },
        {
          asks: "Symmetric form, jitter 0.2, viscosity 0: start, and stop after 0.1 s. How large is the momentum, in kg/(m s)?",
          unit: "kg/(m s)",
          right: [[-0.01, 0.01, "Each pair adds as much as it takes: nothing but rounding is left."]],
          wrong: [[0.1, 100, "That is the plain form, or the liquid has met a wall. Choose the symmetric form."]],
          hint: "Choose the form, start, and read the momentum.",
        },
        {
          asks: "Plain form, viscosity 0, from the start to 0.1 s: by how much has the energy risen, in %?",
          unit: "%",
          right: [[8, 15, "No force from outside acts and no wall. Forces that are no derivative of an energy make it from nothing."]],
          wrong: [[0.5, 3, "That is the symmetric form: its error is the step's, and halves with it."], [105, 120, "That is the energy itself. By how much is it above 100 %?"]],
          hint: "Choose the plain form, start, and stop near 0.1 s.",
        },
      ],
    },
    walls: {
      colour: "speed", energy: true, start: {viscosity: 0.01}, controls: ["walls", "viscosity"],
      questions: [
        {
          asks: "Which height does the middle of the liquid's mass lose at most, in m? The column is 1 m high; at the end it covers a floor of 2 m, with 0.5 m² of liquid.",
          unit: "m",
          right: [[0.37, 0.38, "From 0.5 m to 0.125 m. The potential energy at the end is a quarter of that at the start; nothing may be above the sum of the start."]],
          wrong: [[0.74, 0.76, "That is how far the top falls. The middle of the mass is half as high."], [0.12, 0.13, "That is where it ends. By how much does it fall?"]],
          hint: "The liquid ends 0.25 m high.",
        },
        {
          asks: "A wall pushes with its own pressure, α = 0.01: what is the energy after 0.5 s, in % of that at the start?",
          unit: "%",
          right: [[86, 90, "Viscosity took 12 %, and the wall gave nothing."]],
          wrong: [[102, 106, "That is the wall with the particle's pressure."], [10, 14, "That is what is lost."]],
          hint: "From the start, and stop near 0.5 s.",
        },
        {
          asks: "A wall pushes with the particle's pressure, α = 0: what is the energy after 0.5 s, in %?",
          unit: "%",
          right: [[145, 170, "A particle that is pressed by its neighbours pushes off harder than it pressed the wall. The wall gives energy that nobody put in."]],
          wrong: [[99, 101, "That is the wall with its own pressure."], [45, 70, "How large is it, not how much more?"], [102, 106, "Viscosity still hides it: α = 0."]],
          hint: "Choose the wall and α = 0, start, and stop near 0.5 s.",
        },
      ],
    },
    viscosity: {
      colour: "speed", energy: true, start: {}, controls: ["viscosity", "step", "kernel", "ratio", "spacing"],
      questions: [
        {
          asks: "α = 0.05, step 1: what is left of the energy after 0.5 s, in %?",
          unit: "%",
          right: [[72, 76, "A quarter went into heat, most of it where the liquid meets the floor and the wall."]],
          wrong: [[24, 28, "That is what is lost."], [99, 101, "That is α = 0."]],
          hint: "From the start, and stop near 0.5 s.",
        },
        {
          asks: "α = 0.05: from which step on, a multiple of 0.2 h/c, does the liquid explode?",
          right: [[5.5, 6, "A sound wave then crosses more than the support in a step, 6 · 0.2 = 1.2."]],
          wrong: [[1, 4, "It still holds there: its energy falls."], [4.5, 5, "Nearly: the energy rises by 0.2 %, and then falls."]],
          hint: "Raise the step by one and start again, until the energy leaves the meter.",
        },
        {
          asks: "α = 2: from which of the steps on?",
          right: [[1.01, 1.5, "Viscosity has a limit of its own, about h²/ν with ν of the order of α c h. It falls with α, whatever the speed of sound allows."]],
          wrong: [[5, 6, "That is α = 0.05."], [0.5, 1, "It still holds there."], [2, 4, "It explodes sooner."]],
          hint: "Set α = 2, then raise the step by a notch and start again.",
        },
      ],
    },
  };
})();
