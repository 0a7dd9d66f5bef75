/** The list of recordings: a table of which only the rows on screen are elements, however many there are. */
import { useSignal } from "@preact/signals";
import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import {
  bytes,
  dateWords,
  namesOfDevices,
  flaw,
  isKnown,
  length,
  recordingTitle,
} from "../../recordings/library-filter";
import {
  LIBRARY_COLUMNS,
  type LibraryColumn,
  sortedBy,
  USUAL_COLUMNS,
  withLibraryColumn,
} from "../../recordings/library-view";
import type { RecordingInfo } from "../../wire/recording-types";
import { Button } from "../../ui/controls/button";
import { Card } from "../../ui/controls/card";
import { IconButton } from "../../ui/controls/icon-button";
import { Icon } from "../../ui/controls/icons";
import { SimulatedTag } from "../../ui/controls/simulated-tag";
import { TableHead } from "../../ui/controls/table-head";
import { css, surface } from "../../ui/dom/canvas";
import { theme } from "../../ui/dom/theme";
import type { App } from "../../page/context";
import { go, href } from "../../page/route";
import { Slot } from "../../extension/extension";
import { type Library, libraryOf } from "./library-store";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/recordings";

/** Height of a row until one is measured, px. */
const ROW_PX = 57;
/** Rows beyond each end of the screen: a scroll finds them there. */
const SPARE_ROWS = 8;

const rowId = (info: RecordingInfo): string => `recording-${info.id}`;
const canOpen = (info: RecordingInfo): boolean => !info.recording && info.deleted === null;

export function RecordingList({ app }: { readonly app: App }) {
  const library = libraryOf(app);
  const { all, shown, trouble } = library;
  if (trouble.value && all.value === undefined)
    return <Card title={TEXT.theListCouldNotBeLoaded} message={`${trouble.value.message} ${trouble.value.hint}`} />;
  if (all.value === undefined) return <div class="recording-list" aria-busy="true" />;
  if (all.value.length === 0) return <Card title={TEXT.noRecordingYet} message={TEXT.noRecordingHint} />;
  if (shown.value.length === 0) return <Card title={TEXT.noMatches} message={TEXT.noMatchesHint} />;
  return <Table app={app} library={library} />;
}

interface TableProps {
  readonly app: App;
  readonly library: Library;
}

function Table({ app, library }: TableProps) {
  const box = useRef<HTMLDivElement>(null);
  const [first, rows, height] = [useSignal(0), useSignal(Math.ceil(innerHeight / ROW_PX)), useSignal(ROW_PX)];
  const list = library.shown.value;
  const { columns, ...order } = library.table.value;
  const shown: ReadonlySet<LibraryColumn> = new Set(columns ?? USUAL_COLUMNS);
  // what a row measures depends on the window; the room for them, too
  useLayoutEffect(() => {
    const host = box.current;
    if (!host) return undefined;
    const measure = (): void => {
      height.value =
        host.querySelector<HTMLElement>("tr[aria-rowindex]:not(:first-child)")?.offsetHeight || height.peek();
      rows.value = Math.ceil((host.clientHeight || innerHeight) / height.value);
      scrolled();
    };
    const scroller = scrollerOf(host);
    const scrolled = (): void => {
      const top = scroller === host ? host.scrollTop : -host.getBoundingClientRect().top;
      first.value = Math.max(0, Math.floor(top / height.peek() / SPARE_ROWS) * SPARE_ROWS - SPARE_ROWS);
    };
    const watch = new ResizeObserver(measure);
    watch.observe(host);
    const target: EventTarget = scroller === host ? host : window;
    target.addEventListener("scroll", scrolled, { passive: true });
    measure();
    return () => {
      watch.disconnect();
      target.removeEventListener("scroll", scrolled);
    };
  }, [first, rows, height]);
  const from = Math.min(first.value, Math.max(0, list.length - rows.value));
  const to = Math.min(list.length, from + rows.value + 3 * SPARE_ROWS);
  const at = library.selected.value;
  const active = list.slice(from, to).find(({ id }) => id === at);
  const heads = LIBRARY_COLUMNS.filter(({ name }) => shown.has(name));
  const head = heads.map(({ name, title, isNumber, key }) => ({
    "data-column": name,
    class: isNumber ? "num" : "",
    text: key ? (
      <button
        type="button"
        title={TEXT.sortBy(title)}
        onClick={() => library.look(sortedBy(library.table.peek(), name))}
      >
        {title}
        {order.by === name && <Icon name={order.isDescending ? "down" : "up"} />}
      </button>
    ) : (
      title
    ),
    ...(key && { "aria-sort": directionOf(order, name) }),
  }));
  const spacer = (n: number) =>
    n > 0 && (
      <tr class="spacer" style={{ height: `${n * height.value}px` }}>
        <td />
      </tr>
    );
  return (
    <div class={`recording-list ${columns ? "own-columns" : ""} ${library.isPicking.value ? "picking" : ""}`} ref={box}>
      <table
        // biome-ignore lint/a11y/noNoninteractiveElementToInteractiveRole: rows are selected in it
        role="grid"
        tabIndex={0}
        aria-multiselectable
        aria-label={COMMON.recordings}
        aria-rowcount={list.length + 1}
        aria-activedescendant={active && rowId(active)}
        onKeyDown={(event) => onKey(event, library, (index) => reveal(box.current, index, height.peek()))}
      >
        <caption class="visually-hidden">
          {TEXT.recordingsBy(LIBRARY_COLUMNS.find(({ name }) => name === order.by)?.title ?? "")}
        </caption>
        <colgroup>
          <col data-column="check" />
          {heads.map(({ name, width }) => (
            <col key={name} data-column={name} style={width ? { width: `${width}px` } : {}} />
          ))}
        </colgroup>
        <TableHead
          of={[
            {
              "data-column": "check",
              text: (
                <Check
                  label={TEXT.selectAll}
                  isOn={library.several.value.length === list.length}
                  set={(isOn) => library.pickAll(isOn ? list.map(({ id }) => id) : [])}
                />
              ),
            },
            ...head,
          ]}
        />
        <tbody>
          {spacer(from)}
          {list.slice(from, to).map((info, i) => (
            <Row key={info.id} app={app} library={library} info={info} index={from + i} shown={shown} />
          ))}
          {spacer(list.length - to)}
        </tbody>
      </table>
    </div>
  );
}

/** The list itself, or on a phone the page. */
const scrollerOf = (host: HTMLElement): HTMLElement | undefined =>
  getComputedStyle(host).overflowY === "visible" ? undefined : host;

function directionOf(view: { readonly by: LibraryColumn; readonly isDescending: boolean }, name: LibraryColumn) {
  return view.by !== name ? ("none" as const) : view.isDescending ? ("descending" as const) : ("ascending" as const);
}

function reveal(host: HTMLElement | null, index: number, height: number): void {
  if (!host || scrollerOf(host) === undefined) return;
  const head = host.querySelector("thead")?.offsetHeight ?? 0;
  const top = index * height;
  if (top < host.scrollTop) host.scrollTop = top;
  else if (top + height + head > host.scrollTop + host.clientHeight)
    host.scrollTop = top + height + head - host.clientHeight;
}

const PAGE_ROWS = 10;
const STEPS: Readonly<Record<string, number>> = {
  ArrowUp: -1,
  ArrowDown: 1,
  PageUp: -PAGE_ROWS,
  PageDown: PAGE_ROWS,
  Home: -Infinity,
  End: Infinity,
};

/** Keys of the list, as in a file manager. */
function onKey(event: KeyboardEvent, library: Library, show: (index: number) => void): void {
  if (event.target !== event.currentTarget || event.altKey) return;
  const list = library.shown.peek();
  const at = list.findIndex(({ id }) => id === library.selected.peek());
  const step = STEPS[event.key];
  const info = list[at];
  if (step !== undefined) {
    const to = Math.min(list.length - 1, Math.max(0, at + step));
    const next = list[to];
    if (next) library.pick(next.id, event.shiftKey ? "range" : "alone");
    show(to);
  } else if (event.key.toLowerCase() === "a" && (event.ctrlKey || event.metaKey))
    library.pickAll(list.map(({ id }) => id));
  else if (event.ctrlKey || event.metaKey) return;
  else if (event.key === " " && info) library.pick(info.id, "toggled");
  else if (event.key === "Enter" && info && canOpen(info)) go("recordings", info.id);
  else if (event.key === "Escape" && library.picked.peek().size > 1) library.pickAll([]);
  else if (event.key === "Delete") void library.remove(...library.several.peek().filter(canOpen));
  else return;
  event.preventDefault();
}

interface CheckProps {
  readonly label: string;
  readonly isOn: boolean;
  readonly set: (isOn: boolean) => void;
}

function Check({ label, isOn, set }: CheckProps) {
  return (
    // biome-ignore lint/a11y/useKeyWithClickEvents: only keeps the press from the row
    <label class="row-check" onClick={(event) => event.stopPropagation()}>
      <input
        type="checkbox"
        tabIndex={-1}
        aria-label={label}
        checked={isOn}
        onChange={(event) => set(event.currentTarget.checked)}
      />
    </label>
  );
}

interface RowProps extends TableProps {
  readonly info: RecordingInfo;
  readonly index: number;
  readonly shown: ReadonlySet<LibraryColumn>;
}

function Row({ app, library, info, index, shown }: RowProps) {
  const { tone, words } = flaw(info);
  const name = library.nameOf(info);
  // its date has a place of its own in the row
  const title = recordingTitle(info);
  const called = name === `${title} · ${dateWords(info.started)}` ? title : name;
  const size = bytes(info.recording ? (app.store.recorder.value?.bytes ?? info.size) : info.size);
  const isOn = library.picked.value.has(info.id);
  const press = (event: MouseEvent): void => {
    const link = event.ctrlKey || event.metaKey || event.shiftKey ? "a, button" : "button"; // the link is opened elsewhere
    if (event.target instanceof Element && event.target.closest(link) !== null) return;
    const isAdded = event.ctrlKey || event.metaKey || library.isPicking.peek();
    library.pick(info.id, event.shiftKey ? "range" : isAdded ? "toggled" : "alone");
  };
  const devices = namesOfDevices(info);
  const isTitled = info.title !== "" && info.title !== info.id;
  const about = info.damaged || (isTitled && info.notes) || ((isTitled || info.notes !== "") && devices) || info.file;
  const cells: Readonly<Record<LibraryColumn, () => preact.ComponentChildren>> = {
    motion: () => <Thumb info={info} />,
    name: () => (
      <>
        <b title={name}>
          {canOpen(info) ? (
            <a href={href("recordings", info.id)} tabIndex={-1} {...library.aboutToOpen(info)}>
              {called}
            </a>
          ) : (
            called
          )}
          {info.pinned && <Icon name="pin" />}
        </b>
        <small class="ellipsis" title={about}>
          {info.recording && (
            <span class="tag recording-now">
              <i class="record-dot" /> {TEXT.recordingNow}
            </span>
          )}
          {tone !== "" && <span class={`tag ${tone} phone`}>{words}</span>}
          <SimulatedTag of={info.devices.find(({ simulated }) => simulated)} />{" "}
          <Slot name="recordingRow" with={{ app, info }} />
          {about}
        </small>
      </>
    ),
    devices: () => <span class="two-lines">{devices || "—"}</span>,
    recorded: () => dateWords(info.started),
    length: () => (
      <>
        {length(info.duration)}
        <small class="phone">{dateWords(info.started)}</small>
      </>
    ),
    size: () => (
      <>
        {size.value}
        <span class="unit">{size.unit}</span>
      </>
    ),
    loss: () =>
      tone !== "" ? <span class={`tag ${tone}`}>{words}</span> : isKnown(info) && <span class="dim">{words}</span>,
    tags: () => (
      <span class="tags">
        {info.tags.map((tag) => (
          <span class="tag outlined" key={tag}>
            {tag}
          </span>
        ))}
      </span>
    ),
    markers: () => info.markers || "",
    file: () => <span class="two-lines">{info.file}</span>,
  };
  return (
    <tr
      id={rowId(info)}
      class={isOn || library.selected.value === info.id ? "on" : ""}
      aria-selected={isOn}
      aria-rowindex={index + 2}
      onMouseDown={(event) => event.shiftKey && event.preventDefault()} // selects rows, not their words
      onClick={press}
      onDblClick={() => canOpen(info) && go("recordings", info.id)}
    >
      <td data-column="check">
        <Check label={TEXT.selectRow(name)} isOn={isOn} set={() => library.pick(info.id, "toggled")} />
      </td>
      {LIBRARY_COLUMNS.map(
        (column) =>
          shown.has(column.name) && (
            <td key={column.name} data-column={column.name} class={column.isNumber ? "num" : ""}>
              {cells[column.name]()}
            </td>
          ),
      )}
      <td class="phone">
        <IconButton
          icon="dots"
          label={TEXT.detailsOf(name)}
          onClick={() => {
            library.pick(info.id);
            app.sheet.value = "side";
          }}
        />
      </td>
    </tr>
  );
}

/** A mark is never narrower than this, px. */
const MARK_PX = 2;

function Thumb({ info }: { readonly info: RecordingInfo }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const { motion, thumbnail, losses, marks } = info;
  const look = theme.value;
  const isRead = isKnown(info);
  useEffect(() => {
    if (!canvas.current) return undefined;
    const to = surface(canvas.current, draw);
    function draw(): void {
      if (!to.begin()) return;
      const [x, width, height] = [to.context, to.width(), to.height()];
      const step = width / Math.max(1, thumbnail.length);
      const y = (share: number): number => 2 + (1 - share) * (height - 4);
      x.fillStyle = css("--ink-2");
      thumbnail.forEach(([low, high], i) => {
        if (low === undefined || high === undefined) return;
        const tall = Math.max(1.5, y(low) - y(high));
        x.fillRect(i * step, (y(low) + y(high) - tall) / 2, Math.max(0.8, step * 0.7), tall);
      });
      const place = (at: number): number => Math.min(width - MARK_PX, at * width);
      x.fillStyle = css("--yours");
      for (const at of marks) x.fillRect(place(at), 0, MARK_PX, height / 4);
      x.fillStyle = css("--loss");
      for (const at of losses) x.fillRect(place(at), height / 4, MARK_PX, height * 0.75);
    }
    draw();
    return () => to.dispose();
  }, [thumbnail, losses, marks, look, isRead]);
  if (!isRead) return info.recording ? null : <span class="thumbnail unread">{TEXT.notReadYet}</span>;
  const more = [
    ...(losses.length > 0 ? [TEXT.lostInPlaces(losses.length)] : []),
    ...(marks.length > 0 ? [TEXT.markedInPlaces(marks.length)] : []),
  ];
  const words = [TEXT.motionOverTheRecording(motion), ...more].join(", ");
  return (
    <div class="thumbnail" title={words}>
      <canvas ref={canvas} role="img" aria-label={words} />
      <small aria-hidden="true">{motion}</small>
    </div>
  );
}

/** The choice of columns; those that nobody chose give way where there is no room. */
export function ColumnMenu({ library }: { readonly library: Library }) {
  const now = library.table.value.columns ?? USUAL_COLUMNS;
  const close = ({ currentTarget }: { readonly currentTarget: HTMLDetailsElement }): void => {
    currentTarget.open = false;
  };
  return (
    <details
      class="column-choice desk"
      onKeyDown={(event) => event.key === "Escape" && close(event)}
      onFocusOut={(event) =>
        event.relatedTarget !== null && !event.currentTarget.contains(event.relatedTarget as Node) && close(event)
      }
    >
      <summary class="btn edge">
        <Icon name="sliders" />
        {TEXT.columns}
      </summary>
      <div role="group" aria-label={TEXT.columns}>
        {LIBRARY_COLUMNS.filter(({ name }) => name !== "name").map(({ name, title }) => (
          <label key={name}>
            <input
              type="checkbox"
              checked={now.includes(name)}
              onChange={(event) =>
                library.look(withLibraryColumn(library.table.peek(), name, event.currentTarget.checked))
              }
            />
            {title}
          </label>
        ))}
        <Button
          look="small"
          words={TEXT.usualColumns}
          onClick={() => {
            const { columns: _, ...view } = library.table.peek();
            library.look(view);
          }}
        />
      </div>
    </details>
  );
}
