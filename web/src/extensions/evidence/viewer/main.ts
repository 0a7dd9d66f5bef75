/** Entry of the viewer in an evidence file: a bundle of its own, put into the file (server/extensions/evidence/document.py). */
import "../../../ui/tokens.css";
import "./evidence.css";
import { type Content, embeddedPlots } from "./content";
import { EvidenceViewer } from "./viewer";
import { parseForeign } from "../../../wire/foreign-text";

const textOf = (id: string): string => document.getElementById(id)?.textContent ?? "";

function start(): void {
  const host = document.getElementById("plots");
  if (host === null) return;
  const content = parseForeign(textOf("content")) as Content;
  const light = matchMedia("(prefers-color-scheme: light)");
  const paint = (isPaper: boolean): void => {
    document.documentElement.dataset["theme"] = isPaper || light.matches ? "light" : "dark";
  };
  paint(false);
  const viewer = new EvidenceViewer(
    content,
    embeddedPlots(content, (number) => textOf(`block-${number}`)),
    host,
  );
  light.addEventListener("change", () => {
    paint(false);
    viewer.repaint();
  });
  for (const [name, isPaper] of [["beforeprint", true] as const, ["afterprint", false] as const]) {
    addEventListener(name, () => {
      paint(isPaper);
      viewer.paper(isPaper);
      // They cannot be opened on paper.
      if (isPaper) for (const details of document.querySelectorAll("details")) details.open = true;
    });
  }
  for (const button of document.querySelectorAll<HTMLElement>("button.time"))
    button.addEventListener("click", () => {
      const { time, end } = button.dataset;
      viewer.goTo(Number(time), end === undefined ? undefined : Number(end));
      host.scrollIntoView({ block: "nearest" });
    });
  window.addEventListener("keydown", (event) => onKey(event, viewer));
}

function onKey(event: KeyboardEvent, viewer: EvidenceViewer): void {
  if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return;
  if (event.target instanceof Element && event.target.closest(".wide, details") !== null) return;
  const middle = viewer.timeAt(0.5);
  const actions: Readonly<Record<string, () => void>> = {
    ArrowLeft: () => viewer.pan(-0.1),
    ArrowRight: () => viewer.pan(0.1),
    "+": () => viewer.zoom(0.5),
    "=": () => viewer.zoom(0.5),
    "-": () => viewer.zoom(2),
    "0": () => viewer.whole(),
    a: () => viewer.setCursor("a", middle),
    b: () => viewer.setCursor("b", middle),
    ",": () => viewer.stepCursor("a", -1),
    ".": () => viewer.stepCursor("a", 1),
    "<": () => viewer.stepCursor("b", -1),
    ">": () => viewer.stepCursor("b", 1),
    ";": () => viewer.stepCursor("b", -1), // Shift with comma and period on other keyboards
    ":": () => viewer.stepCursor("b", 1),
    Escape: () => viewer.clear(),
  };
  const action = actions[event.key];
  if (action === undefined) return;
  event.preventDefault();
  action();
}

start();
