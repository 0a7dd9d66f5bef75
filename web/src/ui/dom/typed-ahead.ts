/** Keys typed while a part with a field is on its way: they wait, and go to the field that has the focus once it is there. */

/** Takes typed characters until the returned function is called, which gives them to the field in focus. */
export function holdTyping(): () => void {
  let typed = "";
  const isField = (element: Element | null): element is HTMLInputElement | HTMLTextAreaElement =>
    element instanceof HTMLTextAreaElement ||
    (element instanceof HTMLInputElement && /^(text|search|url|number)$/.test(element.type));
  const onKey = (event: KeyboardEvent): void => {
    const { key, ctrlKey, altKey, metaKey } = event;
    if (ctrlKey || altKey || metaKey || isField(document.activeElement)) return;
    if (key === "Backspace") typed = typed.slice(0, -1);
    else if (key.length === 1) typed += key;
    else return; // Esc closes what was asked for
    event.preventDefault();
    event.stopImmediatePropagation();
  };
  addEventListener("keydown", onKey, { capture: true });
  return () => {
    removeEventListener("keydown", onKey, { capture: true });
    const field = document.activeElement;
    if (typed === "" || !isField(field)) return;
    field.value += typed;
    typed = "";
    field.dispatchEvent(new InputEvent("input", { bubbles: true }));
  };
}
