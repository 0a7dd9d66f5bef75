/** A dialog of the browser's own kind: it traps focus, closes on Esc, and gives focus back. */
import type { ComponentChildren } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { IconButton } from "./icon-button";
import { COMMON } from "../../texts/common";

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
  /** Closed below, or gone with a page that is redrawn: the browser's `close` says nothing new. */
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
  // Closed here, which gives focus back, and said at once: the browser's `close` may come after a key that opens it again.
  const leave = (): void => {
    isGone.current = true;
    ref.current?.close();
    onClose();
  };
  const onCancel = (event: Event): void => {
    if (event.target !== ref.current) return; // a file chooser's, which bubbles
    event.preventDefault();
    leave();
  };
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
    if (!inside) leave();
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
        <IconButton icon="close" label={COMMON.close} title={COMMON.closeEsc} onClick={leave} />
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
