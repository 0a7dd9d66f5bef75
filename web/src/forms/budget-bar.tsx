/** The link budget as one bar: the share of every output, what it was before, the rates that the device could have. */
import type { ComponentChildren } from "preact";
import { number } from "../ui/format";
import { barOf, capacityAt, overWords } from "./budget";
import type { LoadInfo } from "./types";

interface Props {
  readonly load: LoadInfo;
  readonly before: LoadInfo | null;
  /** The rate that edits will bring; undefined while none changes it. */
  readonly baud: number | undefined;
  readonly rates: readonly number[];
  readonly changed: (path: string) => boolean;
  readonly hot: string;
  readonly hover: (path: string) => void;
  /** "Make it fit". */
  readonly children?: ComponentChildren;
}

/** Below this share of the bar a name would be cut. */
const NAMED = 0.09;

export function BudgetBar({ load, before, baud, rates, changed, hot, hover, children }: Props) {
  const bar = barOf(load, before, baud, rates);
  const over = overWords(load, baud);
  const rate = baud ?? load.baud;
  return (
    <section class={`budget ${over ? "toomuch" : ""}`} aria-label="Link budget">
      <div class="row">
        <h3>Link budget</h3>
        <span data-load>
          {number(load.total, 0)}
          <span class="u">B/s</span>
        </span>
        {bar.fill !== undefined && (
          <span class="mid">
            {number(100 * bar.fill, 1)}
            <span class="u">% of {rate ? `${number(rate, 0)} Bd` : "the link"}</span>
          </span>
        )}
        <span class="grow" />
        <span class="dim desk beside">
          {[
            load.measured === null ? "" : `measured ${number(load.measured, 0)} B/s`,
            before && Math.abs(before.total - load.total) > 0.5 ? `before ${number(before.total, 0)} B/s` : "",
          ]
            .filter(Boolean)
            .join(" · ")}
        </span>
        {children}
      </div>
      {over && (
        <p class="over-words" role="status">
          <span class="dot bad" /> {over}
        </p>
      )}
      <div class="bb" aria-hidden="true">
        <div class="track" onPointerLeave={() => hover("")}>
          {bar.shares.map((share) => (
            <i
              key={share.path}
              class={`${changed(share.path) ? "ch" : ""} ${hot !== "" && hot === share.path ? "hot" : ""} ${share.path === "" ? "env" : ""}`}
              style={{ width: `${100 * share.width}%` }}
              title={`${share.title}: ${number(share.bytes, 0)} B/s`}
              onPointerEnter={() => hover(share.path)}
            >
              {share.width >= NAMED ? share.title.split(",")[0] : ""}
            </i>
          ))}
          {bar.over !== undefined && <b class="surplus" style={{ left: `${100 * bar.over}%` }} />}
        </div>
        {bar.before !== undefined && <div class="was" style={{ width: `${100 * bar.before}%` }} />}
        {bar.marks.map((mark) => (
          <span key={mark.baud} class={`tk ${mark.is === "capacity" ? "cap" : mark.is === "other" ? "opt" : ""} ${mark.at < 0.9 ? "mid" : ""}`} style={{ left: mark.at > 0.998 ? "calc(100% - 2px)" : `${100 * mark.at}%` }}>
            <span>
              {number(mark.baud, 0)} Bd{mark.is === "now" ? ", now" : ""}
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
    <div class={`strip budgetline ${fill > 1 ? "toomuch" : ""}`}>
      <span>Link</span>
      <div class="meter">
        <i style={{ width: `${Math.min(100, 100 * fill)}%` }} />
      </div>
      <span>
        <b>{number(100 * fill, 1)}</b>
        <span class="u">% of {rate ? `${number(rate, 0)} Bd` : "the link"}</span>
      </span>
    </div>
  );
}
