// Episodes of a training next to the walk: reward, losses, and which policy walks.

export function showLearning(section, word) {
  section.hidden = false;
  const title = Object.assign(document.createElement("h2"), {textContent: `learning: ${word.text}`});
  const table = document.createElement("table");
  const names = Object.keys(word.episodes[0]?.reward ?? {});
  const row = (kind, cells) => {
    const line = table.insertRow();
    for (const cell of cells) line.append(Object.assign(document.createElement(kind), {textContent: cell}));
  };
  if (word.episodes.length) row("th", ["episode", "stones", "ticks", ...names.map((name) => `reward ${name}`), "critic loss", "swapped at"]);
  for (const episode of word.episodes.slice(-12).reverse())
    row("td", [episode.episode, episode.steps, episode.ticks, ...names.map((name) => episode.reward[name].toPrecision(3)), episode.critic?.toPrecision(3) ?? "", episode.swapped ?? ""]);
  section.replaceChildren(title, table);
}
