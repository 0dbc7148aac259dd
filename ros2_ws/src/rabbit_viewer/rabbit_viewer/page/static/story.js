// What will be seen, what happened, what to try next: the words above the scenes. The server makes the sentences.

const WAITS = "If a robot falls, you see it slowly, and here is why.";

export class Story {
  // `act` does what is offered
  constructor(element, act) {
    [this.sentence, this.happened, this.next] = ["#sentence", "#happened", "#things"].map((id) => element.querySelector(id));
    this.element = element;
    this.act = act;
  }

  begin({story = "", next = [], waits = WAITS}) {
    this.waits = waits;
    this.element.hidden = !story;
    this.sentence.textContent = story;
    this.told = [];
    this.show([]);
    this.next.replaceChildren(...next.map(({text, do: message}) => {
      const button = Object.assign(document.createElement("button"), {textContent: text});
      button.onclick = () => this.act(message);
      return button;
    }));
  }

  // `endings`: of each walker how it ended, null as long as it walks in the picture; what was told stays
  show(endings) {
    endings.forEach((ended, i) => { if (ended?.reason) this.told[i] = ended; });
    const text = this.told.filter(Boolean).map(({reason}) => reason).join(" ") || this.waits;
    this.happened.classList.toggle("waits", text === this.waits);
    if (this.happened.textContent !== text) this.happened.textContent = text;
  }
}
