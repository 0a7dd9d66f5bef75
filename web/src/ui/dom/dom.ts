/** Helpers for panels that write the DOM themselves: an element in one line, a text node written only when it changes. */
import { messageParts } from "./message-parts";

type Attributes = Readonly<Record<string, string>>;

export function el<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: (Node | string)[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

/** The unit that follows a number. */
export function unit(text: string): HTMLSpanElement {
  return el("span", { class: "unit" }, text);
}

/** A piece of text that changes often. */
export class LiveText {
  readonly node = document.createTextNode("");
  #text = "";

  set(text: string): void {
    if (text === this.#text) return;
    this.#text = text;
    this.node.data = text;
  }
}

/** Content of an element with a message: words, and commands as code. */
export function messageNodes(message: string): (Node | string)[] {
  return messageParts(message).map(({ text, isCode }) => (isCode ? el("code", {}, text) : text));
}

/** An element with a message that changes often. */
export class LiveMessage<E extends HTMLElement = HTMLElement> {
  readonly node: E;
  #text = "";

  constructor(node: E) {
    this.node = node;
  }

  get isEmpty(): boolean {
    return this.#text === "";
  }

  set(message: string): void {
    if (message === this.#text) return;
    this.#text = message;
    this.node.replaceChildren(...messageNodes(message));
  }
}

/** True at most `perSecond` times a second, by the clock of the frame loop (ms). */
export function throttle(perSecond: number): (now: number) => boolean {
  let next = Number.NEGATIVE_INFINITY;
  return (now) => {
    if (now < next) return false;
    // Steady pace without drift, and no burst after a pause.
    next = Math.max(next + 1000 / perSecond, now);
    return true;
  };
}

/** Interface of every panel for the page that mounted it. */
export interface Panel {
  /** Draw what has changed; called every frame with the frame's time in ms. */
  update(now: number): void;
  dispose(): void;
}
