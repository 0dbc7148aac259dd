// The training next to the walk as curves over its episodes: stones, reward terms, losses.

import {colour} from "theme";

const CURVES = 4; // with a colour each; more have dashes
let plots = [];

export function showLearning(section, {text, episodes}) {
  section.hidden = false;
  const title = Object.assign(document.createElement("h2"), {textContent: `learning: ${text}`});
  for (const plot of plots) plot.destroy();
  section.replaceChildren(title);
  const terms = (group) => Object.fromEntries([...new Set(episodes.flatMap((each) => Object.keys(each[group])))].map((name) => [name, episodes.map((each) => each[group][name] ?? null)]));
  plots = !episodes.length ? [] : [
    panel(section, "stones", episodes, {stones: episodes.map(({steps}) => steps)}),
    panel(section, "reward a tick", episodes, terms("reward")),
    panel(section, "loss", episodes, terms("losses"), true),
  ];
}

function panel(section, text, episodes, curves, isLog = false) {
  const box = document.createElement("div"), title = Object.assign(document.createElement("h2"), {textContent: text});
  const look = Object.keys(curves).map((_, i) => ({stroke: () => colour(`plot${(i % CURVES) + 1}`), width: 1.5, dash: i < CURVES ? [] : [5, 3], points: {show: true, size: 5}}));
  Object.keys(curves).forEach((name, i) => {
    const label = Object.assign(document.createElement("b"), {textContent: name}), line = document.createElement("i");
    Object.assign(line.style, {borderTopColor: `var(--plot${(i % CURVES) + 1})`, borderTopStyle: i < CURVES ? "solid" : "dashed"});
    label.prepend(line);
    title.append(label);
  });
  box.append(title);
  section.append(box);
  const axis = {stroke: () => colour("faint"), grid: {stroke: () => colour("line"), width: 0.5}, font: "10px system-ui"};
  const positive = (values) => values.map((value) => (isLog && !(value > 0) ? null : value));
  return new uPlot({
    width: Math.max(box.clientWidth, 200), height: 110, legend: {show: false}, cursor: {show: false},
    scales: {x: {time: false}, y: isLog ? {distr: 3} : {}},
    axes: [{...axis, size: 24, incrs: [1, 2, 5, 10, 20, 50]}, {...axis, size: 54}],
    series: [{}, ...look],
  }, [episodes.map(({episode}) => episode + 1), ...Object.values(curves).map(positive)], box);
}
