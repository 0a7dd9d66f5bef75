/** The answer as a table: only the rows on screen are in the document; a click on a heading sorts. */
import { useComputed, useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { Icon } from "../../../ui/controls/icons";
import type { QueryAnswer } from "../../../wire/routes";
import { openingOf, type Opening, type AnswerRow, shownCell, sorted, cellText } from "./answer";
import type { Questions } from "./state";
import { TEXT } from "./texts";

const ROW_PX = 30;
const TOUCH_ROW_PX = 44;
const OVERSCAN_ROWS = 6;
const MEASURED_ROWS = 200;
const [NARROWEST, WIDEST] = [7, 42];
const FIRST_HIGH_PX = 480;

interface Props {
  readonly state: Questions;
  readonly answer: QueryAnswer;
  readonly open: (one: Opening) => void;
}

export function AnswerTable({ state, answer, open }: Props) {
  const host = useRef<HTMLDivElement>(null);
  const [top, high] = [useSignal(0), useSignal(FIRST_HIGH_PX)];
  const rowPx = matchMedia("(max-width: 720px)").matches ? TOUCH_ROW_PX : ROW_PX;
  const rows = useComputed(() => sorted(state.shown.value.answer?.rows ?? [], state.order.value));
  useEffect(() => {
    const element = host.current;
    if (!element) return undefined;
    const resized = new ResizeObserver(() => (high.value = element.clientHeight));
    resized.observe(element);
    return () => resized.disconnect();
  }, [high]);
  useEffect(() => {
    if (host.current) host.current.scrollTop = 0;
  }, [answer]);
  const first = Math.max(0, Math.floor(top.value / rowPx) - OVERSCAN_ROWS);
  const shown = rows.value.slice(first, first + Math.ceil(high.value / rowPx) + 2 * OVERSCAN_ROWS);
  const columns = `${widths(answer)
    .map((n) => `${n}ch`)
    .join(" ")} minmax(0, 1fr)`;
  const sort = (column: number): void => {
    const now = state.order.peek();
    state.order.value =
      now?.column !== column
        ? { column, isDescending: false }
        : now.isDescending
          ? undefined
          : { column, isDescending: true };
  };
  return (
    <div
      class="answer-table text-sm"
      ref={host}
      tabIndex={0}
      role="region"
      aria-label={TEXT.answer}
      onScroll={(event) => (top.value = event.currentTarget.scrollTop)}
    >
      <table
        aria-label={TEXT.answer}
        aria-rowcount={rows.value.length + 1}
        aria-colcount={answer.columns.length}
        style={`--row: ${rowPx}px; --columns: ${columns}`}
      >
        <thead>
          <tr aria-rowindex={1}>
            {answer.columns.map(({ name, kind }, column) => {
              const order = state.order.value?.column === column ? state.order.value : undefined;
              return (
                <th
                  key={name}
                  scope="col"
                  class={kind}
                  aria-sort={!order ? "none" : order.isDescending ? "descending" : "ascending"}
                >
                  <button type="button" title={TEXT.sortBy(name)} onClick={() => sort(column)}>
                    <span class="ellipsis">{name}</span>
                    {order && <Icon name={order.isDescending ? "down" : "up"} />}
                  </button>
                </th>
              );
            })}
          </tr>
        </thead>
        <tbody style={{ height: `${rows.value.length * rowPx}px` }}>
          {shown.map((row, k) => (
            <Line key={first + k} at={first + k} row={row} answer={answer} rowPx={rowPx} open={open} />
          ))}
        </tbody>
      </table>
    </div>
  );
}

interface LineProps extends Omit<Props, "state"> {
  readonly at: number;
  readonly row: AnswerRow;
  readonly rowPx: number;
}

function Line({ at, row, answer, rowPx, open }: LineProps) {
  const opening = openingOf(answer, row);
  return (
    <tr aria-rowindex={at + 2} style={{ transform: `translateY(${at * rowPx}px)` }}>
      {answer.columns.map(({ name, kind }, column) => (
        <td key={name} class={`ellipsis ${kind}`} title={cellText(row[column])}>
          {opening && name === "recording" ? (
            <button
              type="button"
              class="link"
              aria-label={TEXT.openRecording(opening.recording)}
              onClick={() => open(opening)}
            >
              {opening.recording}
            </button>
          ) : (
            shownCell(row[column])
          )}
        </td>
      ))}
    </tr>
  );
}

/** Widths of the columns in characters, by their first rows. */
function widths({ columns, rows }: QueryAnswer): readonly number[] {
  const sample = rows.slice(0, MEASURED_ROWS);
  return columns.map(({ name }, at) => {
    const longest = Math.max(name.length + 2, ...sample.map((row) => shownCell(row[at]).length));
    return Math.min(WIDEST, Math.max(NARROWEST, longest + 3));
  });
}
