(words => { const light = colour => {
    const [r, g, b] = colour.match(/[\d.]+/g).slice(0, 3).map(n => n / 255)
      .map(c => c <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b + 0.05; };
  const paper = light(getComputedStyle(document.body).backgroundColor);
  return words.map(name => { const one = document.querySelector(`#checks .${name}`);
    const ink = one && light(getComputedStyle(one).color);
    return one ? Math.max(ink / paper, paper / ink) : 21; }); })(['refuted', 'fails', 'missed', 'confirmed', 'pass'])
