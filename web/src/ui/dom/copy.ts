/**
 * Copies a text; false where the browser does not let a page. Over plain HTTP, as at a robot's own address, a page has no clipboard but
 * copies a selection: of a field within the open dialog, since what is behind one cannot be selected.
 */
export async function copyText(text: string): Promise<boolean> {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    const before = document.activeElement;
    const field = document.createElement("textarea");
    field.value = text;
    (before?.closest("dialog") ?? document.querySelector("dialog[open]") ?? document.body).append(field);
    field.select();
    const done = document.execCommand("copy");
    field.remove();
    if (before instanceof HTMLElement) before.focus();
    return done;
  }
}
