/** A viewer of others in a frame: its heading, and buttons for a tab of its own, the full screen and closing. */
import { useRef } from "preact/hooks";
import { IconButton } from "../ui/controls/icon-button";
import { TEXT } from "../texts/viewers";

interface Props {
  readonly class: string;
  readonly label: string;
  readonly heading?: string;
  readonly closeHint: string;
  readonly onClose: () => void;
  /** Address of the same in a tab of its own. */
  readonly address?: string | undefined;
  readonly linkClass?: string;
  readonly extra?: preact.ComponentChildren;
  readonly children: preact.ComponentChildren;
}

export function ViewerPanel({ label, heading = label, closeHint, onClose, address, ...props }: Props) {
  const whole = useRef<HTMLElement>(null);
  const enlarge = (): void => {
    if (document.fullscreenElement) void document.exitFullscreen();
    else void whole.current?.requestFullscreen?.().catch(() => undefined);
  };
  return (
    <section class={props.class} ref={whole} aria-label={label}>
      <div class="head">
        <h2 class="ellipsis">{heading}</h2>
        <span class="grow" />
        {props.extra}
        {address && (
          <a
            class={props.linkClass ?? "btn small"}
            href={address}
            target="_blank"
            rel="noopener"
            title={TEXT.newTabHint}
          >
            {TEXT.newTab}
          </a>
        )}
        {document.fullscreenEnabled && (
          <IconButton icon="fit" label={TEXT.fullScreen} title={TEXT.fullScreenHint} onClick={enlarge} />
        )}
        <IconButton icon="close" label={closeHint} onClick={onClose} />
      </div>
      {props.children}
    </section>
  );
}
