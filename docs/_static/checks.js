// Filters the rows of the page of checks; the address keeps what is chosen: checks.html#kind=claim&verdict=refuted
document.addEventListener("DOMContentLoaded", () => {
  const form = document.getElementById("filter");
  if (!form) return;
  const rows = [...document.querySelectorAll("#checks tr.check")];
  const chosen = new URLSearchParams(location.hash.slice(1));
  for (const [name, value] of chosen) if (form.elements[name]) form.elements[name].value = value;
  const filter = () => {
    const wanted = Object.fromEntries(new FormData(form));
    const words = wanted.words.toLowerCase().split(/\s+/).filter(Boolean);
    delete wanted.words;
    let count = 0;
    for (const row of rows) {
      const text = row.textContent.toLowerCase();
      const shown = Object.entries(wanted).every(([name, value]) => !value || row.dataset[name] === value)
        && words.every(word => text.includes(word));
      row.hidden = !shown;
      count += shown;
    }
    form.querySelector("output").textContent = `${count} of ${rows.length}`;
    const said = new URLSearchParams([...new FormData(form)].filter(([, value]) => value)).toString();
    history.replaceState(null, "", said ? `#${said}` : location.pathname + location.search);
  };
  form.addEventListener("input", filter);
  form.addEventListener("submit", event => event.preventDefault());
  filter();
});
