/**
 * Makes links of the figures on loss, gaps and jitter, wherever the page shows them: elements with `data-about="time"`, and the lines of
 * events of those kinds. They lead to the clocks of the device, or of the recording in the player.
 */
import type { App } from "../../page/context";
import { href } from "../../page/route";
import { el } from "../../ui/dom/dom";
import { TEXT } from "./texts";
import "./figure-links.css";

const FIGURES = '[data-about="time"]';
const EVENTS = ":is([data-event=gap], [data-event=clock]):not(.with-bytes)";
const CLASS = "file-time-figure";

/** Follows what is added to the document. */
export function linkFigures(app: App, root: HTMLElement = document.body): () => void {
  const open = (event: Event): void => {
    const figure = event.target instanceof Element ? event.target.closest<HTMLElement>(FIGURES) : null;
    if (!figure) return;
    const { recording } = figure.dataset;
    const show = (): void => void (app.overlay.value = "file-time/clocks");
    const place = recording === undefined ? location.hash : href("recordings", recording);
    if (place === location.hash) return show();
    addEventListener("hashchange", show, { once: true }); // a dialog ends with the page that it was opened on
    location.hash = place;
  };
  const press = (event: KeyboardEvent): void => {
    const isFigure = event.target instanceof Element && event.target.matches(`${FIGURES}[role=link]`);
    if (isFigure && event.key === "Enter") open(event);
  };
  const observer = new MutationObserver((records) => {
    for (const { addedNodes } of records)
      for (const node of addedNodes) if (node instanceof HTMLElement) decorate(node);
  });
  decorate(root);
  observer.observe(root, { childList: true, subtree: true });
  root.addEventListener("click", open);
  root.addEventListener("keydown", press);
  return () => {
    observer.disconnect();
    root.removeEventListener("click", open);
    root.removeEventListener("keydown", press);
  };
}

function decorate(added: HTMLElement): void {
  for (const line of within(added, EVENTS)) {
    line.classList.add("with-bytes");
    const attributes = { type: "button", class: "btn small event-bytes", "data-about": "time", title: TEXT.streamHint };
    line.append(el("button", attributes, TEXT.streamButton));
  }
  for (const figure of within(added, FIGURES)) {
    if (figure instanceof HTMLButtonElement) continue;
    figure.classList.add(CLASS);
    if (figure.closest("[title]") === null) figure.title = TEXT.figureHint; // a help text stays
    if (figure.closest("button")) continue; // which is reached by the keyboard, and leads to the device
    figure.setAttribute("role", "link");
    figure.tabIndex = 0;
  }
}

function within(added: HTMLElement, selector: string): readonly HTMLElement[] {
  return [...(added.matches(selector) ? [added] : []), ...added.querySelectorAll<HTMLElement>(selector)];
}
