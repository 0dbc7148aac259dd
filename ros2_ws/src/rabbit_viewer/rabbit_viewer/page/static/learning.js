// Episodes of a training next to the walk: stones, reward terms, losses.

const SHOWN = 10;

export function showLearning(section, {text, episodes}) {
  section.hidden = false;
  const title = Object.assign(document.createElement("h2"), {textContent: `learning: ${text}`});
  const table = document.createElement("table");
  const row = (kind, cells) => {
    const line = table.insertRow();
    for (const cell of cells) line.append(Object.assign(document.createElement(kind), {textContent: cell}));
  };
  if (episodes.length) {
    const [rewards, losses] = ["reward", "losses"].map((group) => [...new Set(episodes.flatMap((each) => Object.keys(each[group])))]);
    row("th", ["episode", "stones", "ticks", ...rewards.map((name) => `reward ${name}`), ...losses.map((name) => `loss ${name}`)]);
    for (const each of episodes.slice(-SHOWN).reverse())
      row("td", [each.episode + 1, each.steps, each.ticks, ...rewards.map((name) => short(each.reward[name])), ...losses.map((name) => short(each.losses[name]))]);
  }
  section.replaceChildren(title, table);
}

function short(value) {
  return value === undefined ? "" : Number(value).toPrecision(3);
}
