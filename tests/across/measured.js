    const start = some => Liquid.create({...PAGES[page].start, ...some});
    const after = (some, seconds) => {
        const made = start(some);
        while (made.time < seconds) Liquid.advance(made);
        return made;
    };
    const sum = values => values.reduce((a, b) => a + b, 0), total = made => sum(Liquid.energy(made));
    const energy = (some, seconds) => total(after(some, seconds)) / total(start(some));
    const weights = (some, k) => LiquidPage.around(start(some), k).total;
    const explodes = some => [0.5, 1, 1.5, 2, 3, 4, 5, 6].find(step => energy({...some, step}, 0.3) > 2);
