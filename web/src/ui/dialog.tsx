/** A dialog of the browser's own kind: it traps focus, closes on Esc, and gives focus back. */
import type { ComponentChildren } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { IconButton } from "./icon-button";
import { COMMON } from "../texts/common";

interface Props {
  readonly title: string;
  readonly onClose: () => void;
  /** As large as the window allows: for pictures. */
  readonly wide?: boolean;
  readonly children: ComponentChildren;
}

export function Dialog({ title, onClose, wide = false, children }: Props) {
  const ref = useRef<HTMLDialogElement>(null);
  const heading = useRef<HTMLHeadingElement>(null);
  /** A page that is drawn anew takes its dialog with it: nobody closed that one. */
  const isGone = useRef(false);
  useEffect(() => {
    const dialog = ref.current;
    dialog?.showModal();
    // the browser would begin on the button that closes it
    if (document.activeElement === null || !dialog?.querySelector(".inside")?.contains(document.activeElement))
      (fieldIn(dialog) ?? heading.current)?.focus();
    return () => {
      isGone.current = true;
      dialog?.close();
    };
  }, []);
  // A press on the backdrop reports the dialog itself as its target, and lies outside of its box.
  const onPress = (event: MouseEvent): void => {
    const dialog = ref.current;
    if (!dialog || event.target !== dialog) return;
    const box = dialog.getBoundingClientRect();
    const inside =
      event.clientX >= box.left &&
      event.clientX <= box.right &&
      event.clientY >= box.top &&
      event.clientY <= box.bottom;
    if (!inside) onClose();
  };
  // Esc ends the state of the page, and that the dialog: `close` comes later, when the next key may have opened it again.
  const onCancel = (event: Event): void => {
    if (event.target !== ref.current) return; // a file chooser's, which bubbles
    event.preventDefault();
    onClose();
  };
  return (
    <dialog
      ref={ref}
      class={wide ? "wide" : ""}
      aria-labelledby="dialog-title"
      onCancel={onCancel}
      onClose={() => isGone.current || onClose()}
      onMouseDown={onPress}
    >
      <div class="top">
        <h2 id="dialog-title" ref={heading} tabIndex={-1}>
          {title}
        </h2>
        <span class="grow" />
        <IconButton icon="close" label={COMMON.close} title={COMMON.closeEsc} onClick={onClose} />
      </div>
      <div class="inside">{children}</div>
    </dialog>
  );
}

/** The first field of a form, where a keyboard is at hand; on a phone it would call one up. */
function fieldIn(dialog: HTMLElement | null): HTMLElement | null {
  if (matchMedia("(pointer: coarse)").matches) return null;
  return dialog?.querySelector<HTMLElement>(".inside :is(input:not([type=hidden], :disabled), textarea)") ?? null;
}
