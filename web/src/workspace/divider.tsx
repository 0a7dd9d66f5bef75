/** A divider between panels: dragged by mouse or finger, moved by the arrow keys; a double click or Enter gives the default back. */
import { useRef } from "preact/hooks";

/** A press of an arrow key, and one with Shift, px. */
const [STEP_PX, LARGE_STEP_PX] = [10, 50];

interface Props {
  readonly label: string;
  /** Of the divider: a vertical one moves left and right. */
  readonly orientation: "vertical" | "horizontal";
  /** 1: what is sized lies before the divider; −1: after it. */
  readonly sign: 1 | -1;
  /** What is sized, relative to the divider; default: `size` is its size. */
  readonly target?: (divider: HTMLElement) => Element | null | undefined;
  readonly limits: readonly [least: number, greatest: number];
  readonly size: number | undefined;
  readonly onSize: (px: number | undefined) => void;
  readonly style?: Readonly<Record<string, string>>;
}

export function Divider({ label, orientation, sign, target, limits, size, onSize, style = {} }: Props) {
  const ref = useRef<HTMLDivElement>(null);
  const isVertical = orientation === "vertical";
  const now = (): number => {
    const box = (ref.current && target?.(ref.current))?.getBoundingClientRect();
    return box ? (isVertical ? box.width : box.height) : (size ?? limits[0]);
  };
  const onPointerDown = (event: PointerEvent): void => {
    const handle = ref.current;
    if (!handle || event.button !== 0) return;
    event.preventDefault();
    handle.focus();
    handle.setPointerCapture(event.pointerId);
    const at = (of: PointerEvent): number => (isVertical ? of.clientX : of.clientY);
    const [from, before] = [at(event), now()];
    const move = (to: PointerEvent): void => onSize(before + sign * (at(to) - from));
    const end = (): void => {
      handle.removeEventListener("pointermove", move);
      handle.removeEventListener("pointerup", end);
      handle.removeEventListener("pointercancel", end);
    };
    handle.addEventListener("pointermove", move);
    handle.addEventListener("pointerup", end);
    handle.addEventListener("pointercancel", end);
  };
  const onKeyDown = (event: KeyboardEvent): void => {
    const step = event.shiftKey ? LARGE_STEP_PX : STEP_PX;
    const [less, more] = isVertical ? ["ArrowLeft", "ArrowRight"] : ["ArrowUp", "ArrowDown"];
    if (event.key === less) onSize(now() - sign * step);
    else if (event.key === more) onSize(now() + sign * step);
    else if (event.key === "Home") onSize(limits[0]);
    else if (event.key === "End") onSize(limits[1]);
    else if (event.key === "Enter") onSize(undefined);
    else return;
    event.preventDefault();
  };
  return (
    <div
      ref={ref}
      class={`divider ${orientation}`}
      role="separator"
      aria-label={label}
      aria-orientation={orientation}
      aria-valuemin={limits[0]}
      aria-valuemax={limits[1]}
      aria-valuenow={Math.round(size ?? now())}
      aria-valuetext={size === undefined ? undefined : `${size} px`}
      title={label}
      style={style}
      tabIndex={0}
      onPointerDown={onPointerDown}
      onDblClick={() => onSize(undefined)}
      onKeyDown={onKeyDown}
    />
  );
}
