// Dark or light: as the system says, or as was chosen.

const asked = matchMedia("(prefers-color-scheme: dark)");
let chosen = null;
try { chosen = localStorage.getItem("theme"); } catch { /* a file may have no storage */ }
const listeners = [];

function apply() {
  document.documentElement.dataset.theme = chosen ?? (asked.matches ? "dark" : "light");
  for (const listener of listeners) listener();
}

export function toggle() {
  chosen = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
  try { localStorage.setItem("theme", chosen); } catch { /* as above */ }
  apply();
}

export function onTheme(listener) {
  listeners.push(listener);
}

const known = {theme: "", colours: {}};

export function colour(name) {
  const theme = document.documentElement.dataset.theme;
  if (known.theme !== theme) Object.assign(known, {theme, colours: {}});
  return (known.colours[name] ??= getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim());
}

asked.addEventListener("change", apply);
apply();
