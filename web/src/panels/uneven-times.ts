/** Cause of uneven arrival times of a device, behind a button in the list of its health. */
import { el, LiveMessage } from "../ui/dom/dom";
import type { DeviceHealth } from "../wire/types";
import { timeWords } from "./health-text";
import { TEXT } from "../texts/panels";

/**
 * Cause of uneven times of a device and its remedy, behind a button that has its room in a row of the list: a note that came and went
 * with the load of the host would move what is below it.
 */
export function mountUneven(): {
  readonly button: HTMLButtonElement;
  readonly node: HTMLElement;
  update(health: DeviceHealth | undefined): void;
} {
  const words = new LiveMessage(el("p", { class: "note uneven", id: "uneven-times" }));
  const attributes = { type: "button", class: "btn small edge why", "aria-controls": words.node.id } as const;
  const button = el("button", attributes, TEXT.unevenCause);
  let isOpen = false;
  let cause = "";
  const show = (): void => {
    button.style.visibility = cause || isOpen ? "" : "hidden";
    button.ariaExpanded = String(isOpen);
    words.node.hidden = !isOpen;
    if (isOpen) words.set(cause || TEXT.evenAgain);
  };
  button.addEventListener("click", () => {
    isOpen = !isOpen;
    show();
  });
  show();
  return {
    button,
    node: words.node,
    update(health) {
      cause = timeWords(health);
      show();
    },
  };
}
