/** The link budget as one bar: the share of every output, its previous value, the possible rates of the device. */
import type { ComponentChildren } from "preact";
import { number } from "../ui/format/format";
import { barOf, capacityAt, overWords } from "./budget";
import type { LoadInfo } from "../wire/form-types";
import { TEXT } from "../texts/forms";

interface Props {
  readonly load: LoadInfo;
  readonly before: LoadInfo | null;
  /** The rate after the edits; undefined if none changes it. */
  readonly baud: number | undefined;
  readonly rates: readonly number[];
  readonly changed: (path: string) => boolean;
  readonly hot: string;
  readonly hover: (path: string) => void;
  /** "Fit to link". */
  readonly children?: ComponentChildren;
}

/** Below this share of the bar a name would be cut. */
const MIN_NAMED_SHARE = 0.09;

export function BudgetBar({ load, before, baud, rates, changed, hot, hover, children }: Props) {
  const bar = barOf(load, before, baud, rates);
  const over = overWords(load, baud);
  const rate = baud ?? load.baud;
  return (
    <section class={`budget ${over ? "over-capacity" : ""}`} aria-label={TEXT.linkBudget}>
      <div class="row">
        <h3>{TEXT.linkBudget}</h3>
        <span data-load>
          {number(load.total, 0)}
          <span class="unit">B/s</span>
        </span>
        {bar.fill !== undefined && (
          <span class="mid">
            {number(100 * bar.fill, 1)}
            <span class="unit">{rate ? TEXT.ofBaudRate(number(rate, 0)) : TEXT.ofLink}</span>
          </span>
        )}
        <span class="grow" />
        <span class="dim desk beside">
          {[
            load.measured === null ? "" : TEXT.measuredRate(number(load.measured, 0)),
            before && Math.abs(before.total - load.total) > 0.5 ? TEXT.rateBefore(number(before.total, 0)) : "",
          ]
            .filter(Boolean)
            .join(" · ")}
        </span>
        {children}
      </div>
      {over && (
        <p class="over-capacity-words text-sm" role="status">
          <span class="dot bad" /> {over}
        </p>
      )}
      <div class="budget-bar" aria-hidden="true">
        <div class="track" onPointerLeave={() => hover("")}>
          {bar.shares.map((share) => (
            <i
              key={share.path}
              class={`${changed(share.path) ? "changed" : ""} ${hot !== "" && hot === share.path ? "highlighted" : ""} ${share.path === "" ? "envelope" : ""}`}
              style={{ width: `${100 * share.width}%` }}
              title={`${share.title}: ${number(share.bytes, 0)} B/s`}
              onPointerEnter={() => hover(share.path)}
            >
              {share.width >= MIN_NAMED_SHARE ? share.title.split(",")[0] : ""}
            </i>
          ))}
          {bar.over !== undefined && <b class="excess" style={{ left: `${100 * bar.over}%` }} />}
        </div>
        {bar.before !== undefined && <div class="previous" style={{ width: `${100 * bar.before}%` }} />}
        {bar.marks.map((mark) => (
          <span
            key={mark.baud}
            class={`scale-mark ${mark.is === "capacity" ? "capacity" : mark.is === "other" ? "option" : ""} ${mark.at < 0.9 ? "mid" : ""}`}
            style={{ left: mark.at > 0.998 ? "calc(100% - 2px)" : `${100 * mark.at}%` }}
          >
            <span>
              {number(mark.baud, 0)} Bd{mark.is === "now" ? TEXT.now : ""}
            </span>
          </span>
        ))}
      </div>
    </section>
  );
}

/** On a phone the budget stands in one line under the bar. */
export function BudgetLine({ load, baud }: { readonly load: LoadInfo | null; readonly baud: number | undefined }) {
  if (load === null) return null;
  const capacity = capacityAt(load, baud);
  if (capacity === null) return null;
  const fill = load.total / capacity;
  const rate = baud ?? load.baud;
  return (
    <div class={`strip budget-line ${fill > 1 ? "over-capacity" : ""}`}>
      <span>{TEXT.link}</span>
      <div class="meter">
        <i style={{ width: `${Math.min(100, 100 * fill)}%` }} />
      </div>
      <span>
        <b>{number(100 * fill, 1)}</b>
        <span class="unit">{rate ? TEXT.ofBaudRate(number(rate, 0)) : TEXT.ofLink}</span>
      </span>
    </div>
  );
}
