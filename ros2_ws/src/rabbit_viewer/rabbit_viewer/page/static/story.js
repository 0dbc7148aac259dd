// What will be seen, what happened, what to try next: the words above the scenes. The server makes the sentences.

export class Story {
  // `act` does what is offered
  constructor(element, act) {
    [this.sentence, this.happened, this.next] = ["#sentence", "#happened", "#next"].map((id) => element.querySelector(id));
    this.element = element;
    this.act = act;
  }

  begin({story = "", next = []}) {
    this.element.hidden = !story;
    this.sentence.textContent = story;
    this.happened.hidden = this.next.hidden = true;
    this.next.replaceChildren(...next.map(({text, do: message}) => {
      const button = Object.assign(document.createElement("button"), {textContent: text});
      button.onclick = () => this.act(message);
      return button;
    }));
  }

  // `endings`: of each walker how it ended, null as long as it walks in the picture
  show(endings) {
    const told = endings.filter((ended) => ended?.reason);
    this.happened.hidden = !told.length;
    const text = told.map(({reason}) => reason).join(" ");
    if (this.happened.textContent !== text) this.happened.textContent = text;
    this.next.hidden = !told.length && !endings.every(Boolean);
  }
}
