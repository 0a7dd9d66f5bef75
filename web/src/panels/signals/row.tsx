/** A row of the tree of signals: name, rate and frame, the last seconds, the newest value with its unit, and a button that plots it. */
import type { CursorReading } from "../../data/cursor-time";
import { sampleAt } from "../panel-context";
import { decimalsOf, number, rate } from "../../ui/format/format";
import { IconButton } from "../../ui/controls/icon-button";
import { Icon } from "../../ui/controls/icons";
import { TEXT } from "../../texts/signals";
import { beginDrag } from "../../signals/drag";
import { sparkPath, type TreeRow } from "../../signals/tree-rows";

const SPARK = { width: 64, height: 18, intervals: 40, seconds: 10 };

/** A signal alone, one more or less, or all from the last one to it. */
export type Choosing = "one" | "another" | "range";

interface Props {
  readonly row: TreeRow;
  readonly at: CursorReading;
  readonly isCurrent: boolean;
  readonly isTabStop: boolean;
  readonly onFold: () => void;
  /** Without a way it has the focus only. */
  readonly onChoose: (how?: Choosing) => void;
  readonly onPlot: () => void;
  readonly onKey: (event: KeyboardEvent) => void;
}

export function SignalRow({ row, at, isCurrent, isTabStop, onFold, onChoose, onPlot, onKey }: Props) {
  const { key, level, name, channel, columns, open } = row;
  const isSignal = channel !== undefined && columns.length > 0;
  const about = aboutOf(row);
  const { value, unit } = valueOf(row, at);
  const choose = ({ shiftKey, ctrlKey, metaKey }: MouseEvent): void => {
    onChoose(shiftKey ? "range" : ctrlKey || metaKey ? "another" : "one");
    if (!isSignal) onFold();
  };
  return (
    <div
      role="treeitem"
      data-row={key}
      aria-label={[name, about, value, unit].filter(Boolean).join(" ")}
      class="signal-row text-sm"
      aria-level={level}
      aria-selected={isCurrent}
      {...(open === undefined ? {} : { "aria-expanded": open })}
      tabIndex={isTabStop ? 0 : -1}
      draggable={isSignal}
      onDragStart={(event) => beginDrag(event, key)}
      onClick={choose}
      onMouseDown={(event) => (event.shiftKey || event.ctrlKey || event.metaKey) && event.preventDefault()}
      onFocus={() => onChoose()}
      onKeyDown={onKey}
    >
      <span class="signal-name flex-row">
        {open === undefined ? (
          <span class="signal-fold mid" />
        ) : (
          <button
            type="button"
            class="signal-fold mid"
            tabIndex={-1}
            aria-label={open ? TEXT.fold(name) : TEXT.unfold(name)}
            onClick={(event) => {
              event.stopPropagation();
              onFold();
            }}
          >
            <Icon name={open ? "down" : "forward"} />
          </button>
        )}
        <span class="signal-words">
          <span class="ellipsis">{name}</span> {about && <small class="ellipsis">{about}</small>}
        </span>
      </span>{" "}
      <span class="signal-spark">{channel && columns.length === 1 && <Spark row={row} at={at} />}</span>
      <span class="signal-value text-xs">
        {value}
        {unit && <span class="unit"> {unit}</span>}
      </span>
      {isSignal && (
        <IconButton
          icon="plus"
          label={TEXT.plot(name)}
          tabIndex={-1}
          onClick={(event) => {
            event.stopPropagation();
            onChoose();
            onPlot();
          }}
        />
      )}
    </div>
  );
}

function aboutOf({ channel, level }: TreeRow): string {
  if (!channel || level !== 2) return "";
  const { step } = channel.ring;
  const words = [step > 0 ? TEXT.hertz(rate(1 / step)) : TEXT.resting, channel.info.frame, channel.info.group];
  return words.filter(Boolean).join(" · ");
}

/** The newest value of a signal; of several together their unit only. */
function valueOf({ channel, columns }: TreeRow, at: CursorReading): { readonly value: string; readonly unit: string } {
  const [column = 0] = columns;
  const info = channel?.info.columns[column];
  if (!channel || !info) return { value: "", unit: "" };
  if (columns.length > 1) return { value: "", unit: channel.info.unit };
  const i = sampleAt(channel, at);
  const value = number(i < 0 ? NaN : channel.ring.value(column, i), decimalsOf(info));
  return { value, unit: info.unit || channel.info.unit };
}

interface SparkProps {
  readonly row: TreeRow;
  readonly at: CursorReading;
}

function Spark({ row: { channel, columns }, at }: SparkProps) {
  if (!channel) return null;
  const { ring } = channel;
  const newest = ring.length > 0 ? ring.time(ring.length - 1) : 0;
  const end = Number.isFinite(at.time) ? Math.min(at.time, newest) : newest;
  const { width, height, intervals, seconds } = SPARK;
  // a sample needs an interval: of slow signals fewer and wider ones
  const n = Math.max(2, Math.min(intervals, Math.floor(seconds / (1.5 * ring.step || 1))));
  const path = sparkPath(ring.buckets(columns[0] ?? 0, end - seconds, seconds / n, n, "device"), width, height);
  return (
    <svg viewBox={`0 -1 ${width} ${height + 2}`} aria-hidden="true">
      <path d={path} />
    </svg>
  );
}
