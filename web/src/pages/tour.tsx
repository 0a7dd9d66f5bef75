/** A tour of Live in five stops, each beside the part of the page that it is about. The page goes on meanwhile. */
import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";
import { Button } from "../ui/controls/button";
import { IconButton } from "../ui/controls/icon-button";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/live";
import "./tour.css";

/** Where each stop is; on a phone some parts are behind others, which are shown then. */
const PLACES: readonly (readonly string[])[] = [
  ["#rail", ".device-name"],
  [".bar [role=group]", ".dock"],
  ["#plots"],
  ["#side", ".strip", ".bar .only-mid"],
  [".record-button"],
];

interface Box {
  readonly left: number;
  readonly top: number;
  readonly width: number;
  readonly height: number;
}

/** The first of these that is shown, as far as it is on screen. */
function boxOf(selectors: readonly string[]): Box | undefined {
  for (const selector of selectors) {
    const element = document.querySelector(selector);
    if (!element?.getClientRects().length) continue;
    element.scrollIntoView({ block: "nearest" });
    const { left, top, right, bottom } = element.getBoundingClientRect();
    const [x, y] = [Math.max(0, left), Math.max(0, top)];
    return { left: x, top: y, width: Math.min(innerWidth, right) - x, height: Math.min(innerHeight, bottom) - y };
  }
  return undefined;
}

const GAP = 12;

/** Place of a card of this size beside a box: at its right or left if there is room, else below or above, else in its middle. */
export function placeBeside(
  box: Box,
  card: { width: number; height: number },
  page: { width: number; height: number },
) {
  const clamp = (value: number, size: number, all: number): number => Math.max(GAP, Math.min(value, all - size - GAP));
  const x = clamp(box.left + box.width / 2 - card.width / 2, card.width, page.width);
  const y = clamp(box.top, card.height, page.height);
  const [right, bottom] = [box.left + box.width, box.top + box.height];
  if (right + 2 * GAP + card.width < page.width) return { left: right + GAP, top: y };
  if (box.left - 2 * GAP - card.width > 0) return { left: box.left - GAP - card.width, top: y };
  if (bottom + 2 * GAP + card.height < page.height) return { left: x, top: bottom + GAP };
  if (box.top - 2 * GAP - card.height > 0) return { left: x, top: box.top - GAP - card.height };
  return { left: x, top: clamp(box.top + box.height / 2 - card.height / 2, card.height, page.height) };
}

export function Tour({ onClose }: { readonly onClose: () => void }) {
  const [stop, setStop] = useState(0);
  const [box, setBox] = useState<Box>();
  const card = useRef<HTMLElement>(null);
  const heading = useRef<HTMLHeadingElement>(null);
  const before = useRef(document.activeElement);
  const isLast = stop === PLACES.length - 1;
  const place = (): void => setBox(boxOf(PLACES[stop] ?? []));
  // biome-ignore lint/correctness/useExhaustiveDependencies: the place is that of the stop
  useLayoutEffect(() => {
    place();
    addEventListener("resize", place);
    return () => removeEventListener("resize", place);
  }, [stop]);
  useEffect(() => heading.current?.focus({ preventScroll: true }), [stop]);
  useEffect(
    () => () => {
      if (before.current instanceof HTMLElement) before.current.focus();
    },
    [],
  );
  const onKey = (event: KeyboardEvent): void => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (event.key === "Escape") onClose();
    else if (step !== undefined) setStop(Math.max(0, Math.min(PLACES.length - 1, stop + step)));
    else return;
    event.preventDefault(); // not a key of the page
  };
  const size = card.current ?? { offsetWidth: 320, offsetHeight: 170 };
  const at =
    box &&
    placeBeside(
      box,
      { width: size.offsetWidth, height: size.offsetHeight },
      { width: innerWidth, height: innerHeight },
    );
  const { title, words } = TEXT.tour[stop] ?? TEXT.tour[0];
  return (
    <>
      {box && (
        <div
          class="tour-ring"
          aria-hidden="true"
          style={{ left: `${box.left}px`, top: `${box.top}px`, width: `${box.width}px`, height: `${box.height}px` }}
        />
      )}
      <section
        ref={card}
        class="tour card"
        role="dialog"
        aria-labelledby="tour-title"
        aria-describedby="tour-words"
        style={at && { left: `${at.left}px`, top: `${at.top}px` }}
        onKeyDown={onKey}
      >
        <h2 id="tour-title" ref={heading} tabIndex={-1}>
          {title}
          <span class="grow" />
          <IconButton icon="close" label={TEXT.endTour} onClick={onClose} />
        </h2>
        <p id="tour-words">{words}</p>
        <div class="row">
          <span class="dim text-sm grow">{TEXT.stopOf(stop + 1, PLACES.length)}</span>
          <Button look="edge" words={TEXT.tourBack} disabled={stop === 0} onClick={() => setStop(stop - 1)} />
          <Button
            look="main"
            words={isLast ? COMMON.close : TEXT.tourNext}
            onClick={() => (isLast ? onClose() : setStop(stop + 1))}
          />
        </div>
      </section>
    </>
  );
}
