/** The row of further quantities under the plots, one click each; grouped by message if they are many. */
import type { ViewState } from "../data/view-state";
import { el, unit } from "../ui/dom/dom";
import type { PlotSpec } from "../data/view";
import { TEXT } from "../texts/plots";

/** With more further quantities than this they are grouped by message. */
const MAX_OFFERED = 12;

interface Answer {
  /** A quantity was switched on or off. */
  readonly shown: (key: string) => void;
  /** The row has another height. */
  readonly resized: () => void;
}

export class MoreQuantities {
  readonly root = el("div", { class: "more-quantities", role: "group", "aria-label": TEXT.moreQuantities });
  readonly #state: Pick<ViewState, "extraPlots">;
  readonly #openSignals: (() => void) | undefined;
  readonly #answer: Answer;

  constructor(state: Pick<ViewState, "extraPlots">, openSignals: (() => void) | undefined, answer: Answer) {
    this.#state = state;
    this.#openSignals = openSignals;
    this.#answer = answer;
    const { root } = this;
    root.addEventListener("wheel", (event) => {
      if (event.deltaX !== 0 || root.scrollWidth <= root.clientWidth) return;
      event.preventDefault(); // the wheel scrolls along the row, which has no scroll bar
      root.scrollLeft += event.deltaY;
    });
  }

  /** Offer those of the plots that are not shown initially. */
  offer(specs: readonly PlotSpec[], extra: ReadonlySet<string>): void {
    const { root } = this;
    const others = specs.filter(({ primary }) => !primary);
    root.hidden = others.length === 0 && this.#openSignals === undefined;
    const open = new Set(
      [...root.querySelectorAll("details[open]")].map((details) => details.getAttribute("data-group")),
    );
    const groups = new Map<string, PlotSpec[]>();
    for (const spec of others) {
      const group = others.length > MAX_OFFERED ? spec.group : "";
      groups.set(group, [...(groups.get(group) ?? []), spec]);
    }
    root.classList.toggle("grouped", groups.size > 1);
    root.replaceChildren(TEXT.moreQuantities);
    if (this.#openSignals) {
      const all = el("button", { type: "button", title: TEXT.allSignalsHint }, TEXT.allSignals);
      all.addEventListener("click", this.#openSignals);
      root.append(all);
    }
    for (const [group, own] of groups) {
      const buttons = own.map((spec) => this.#button(spec, extra.has(spec.key), group));
      if (group === "") {
        root.append(...buttons);
        continue;
      }
      const details = el(
        "details",
        { "data-group": group },
        el("summary", {}, group, unit(String(own.length))),
        ...buttons,
      );
      details.open = open.has(group);
      details.addEventListener("toggle", this.#answer.resized);
      root.append(details);
    }
  }

  #button({ key, title, unit: unitText, frame, series }: PlotSpec, on: boolean, group: string): HTMLElement {
    const suffix = ` · ${group}`;
    const words = group !== "" && title.endsWith(suffix) ? title.slice(0, -suffix.length) : title;
    const button = el("button", { type: "button", "aria-pressed": String(on), "data-plot": key }, words);
    const tail = [unitText, frame].filter(Boolean).join(" ");
    if (tail !== "") button.append(unit(tail));
    if (series[0]?.channel.info.verified === false)
      button.append(
        el("span", { class: "warned", title: TEXT.unverifiedHint }, " ▲"),
        el("span", { class: "visually-hidden" }, TEXT.unverified),
      );
    button.addEventListener("click", () => {
      const next = new Set(this.#state.extraPlots.peek());
      if (!next.delete(key)) next.add(key);
      this.#state.extraPlots.value = next;
      // the row was rendered again: restore focus to the pressed button
      this.root.querySelector<HTMLElement>(`[data-plot="${CSS.escape(key)}"]`)?.focus();
      this.#answer.shown(key);
    });
    return button;
  }
}
