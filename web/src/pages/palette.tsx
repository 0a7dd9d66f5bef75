/**
 * The command palette: every page, action, panel, device, signal, recording and setting, found by typing. Enter does what the chosen line
 * says; nothing is sent to a device.
 */
import { useComputed, useSignal } from "@preact/signals";
import { useEffect, useId, useRef } from "preact/hooks";
import { type Index, indexOf, search } from "../forms/search";
import { isShown, show } from "../data/layout";
import type { App, Deps } from "../page/context";
import { select, shownPlots } from "../page/app-state";
import { keyGroups } from "../page/keys";
import { go, href, pagesOf, route } from "../page/route";
import { putOn } from "../panels/signals/panel";
import { recordingsApi } from "../recordings/api";
import { dateWords, recordingMatches, recordingTitle, wordsOf } from "../recordings/library-filter";
import { request } from "../requests/http";
import { treeRows } from "../signals/tree-rows";
import { Dialog } from "../ui/controls/dialog";
import { SearchField } from "../ui/controls/search-field";
import { TEXT } from "../texts/palette";
import { fullName } from "../wire/device-name";
import { panelsOf } from "../workspace/panels";
import { sessionOf } from "../workspace/session";
import type { Forms } from "../wire/form-types";
import type { RecordingInfo } from "../wire/recording-types";
import "./palette.css";

interface Entry {
  readonly kind: keyof typeof TEXT.kinds;
  readonly title: string;
  readonly about?: string;
  readonly run: () => void;
}

/** Lines of one kind, and of all. */
const [MAX_OF_KIND, MAX_LINES] = [20, 60];

interface Props {
  readonly app: App;
  readonly onClose: () => void;
}

export function CommandPalette({ app, onClose }: Props) {
  const query = useSignal("");
  const at = useSignal(0);
  const list = useId();
  const recordings = useSignal<readonly RecordingInfo[]>([]);
  const forms = useSignal<Forms | undefined>(undefined);
  const device = app.device.value;
  const configured = device?.protocol ? device.id : undefined;
  const deps = shownPlots(app).value ?? app;
  useEffect(() => {
    void recordingsApi.list().then((outcome) => outcome.ok && (recordings.value = outcome.value));
  }, [recordings]);
  useEffect(() => {
    if (configured === undefined) return;
    void request("GET /api/devices/{device}/forms", { path: { device: configured } }).then(
      (outcome) => outcome.ok && (forms.value = outcome.value),
    );
  }, [configured, forms]);
  const index = useComputed(() => (forms.value ? indexOf(forms.value) : []));
  const found = useComputed((): readonly Entry[] => {
    const typed = query.value.trim();
    const fixed = [
      ...pages(app),
      ...(route.value.page === "live" || route.value.recording !== undefined ? actions() : []),
      ...panels(app, deps),
      ...devices(app),
    ];
    if (typed === "") return fixed;
    const words = wordsOf(typed);
    const own = fixed.filter(({ kind, title, about = "" }) => {
      const text = `${TEXT.kinds[kind]} ${title} ${about}`.toLowerCase();
      return words.every((word) => text.includes(word));
    });
    const others = [signals(deps, typed), settings(index.value, typed, device?.id), files(recordings.value, words)];
    const parts = [own, ...others].map((part) => part.slice(0, MAX_OF_KIND));
    return parts.flat().slice(0, MAX_LINES);
  });
  const chosen = Math.min(at.value, found.value.length - 1);
  const run = (entry: Entry | undefined): void => {
    if (!entry) return;
    onClose();
    entry.run();
  };
  const box = useRef<HTMLDivElement>(null);
  const onKey = (event: KeyboardEvent): void => {
    const steps: Readonly<Record<string, number>> = { ArrowDown: 1, ArrowUp: -1, PageDown: 8, PageUp: -8 };
    const step = steps[event.key];
    if (event.key === "Enter") run(found.value[chosen]);
    else if (step !== undefined) {
      at.value = Math.min(Math.max(chosen + step, 0), found.value.length - 1);
      box.current?.children[at.value]?.scrollIntoView({ block: "nearest" });
    } else return;
    event.preventDefault();
  };
  return (
    <Dialog title={TEXT.title} onClose={onClose}>
      <div class="palette">
        <SearchField
          label={TEXT.search}
          placeholder={TEXT.hint}
          value={query.value}
          onText={(text) => {
            query.value = text;
            at.value = 0;
          }}
          onKeyDown={onKey}
          controls={{ list, option: chosen < 0 ? undefined : `${list}-${chosen}` }}
        />
        <div id={list} ref={box} role="listbox" aria-label={TEXT.title} class="palette-list">
          {found.value.map((entry, k) => (
            <div
              key={`${entry.kind} ${entry.title} ${entry.about}`}
              id={`${list}-${k}`}
              role="option"
              tabIndex={-1}
              aria-selected={k === chosen}
              onPointerMove={() => (at.value = k)}
              onMouseDown={(event) => {
                event.preventDefault();
                run(entry);
              }}
            >
              <span class="ellipsis">{entry.title}</span>
              <small class="dim ellipsis">{entry.about}</small>
              <small class="dim">{TEXT.kinds[entry.kind]}</small>
            </div>
          ))}
        </div>
        {found.value.length === 0 && <p class="dim">{TEXT.nothingFound(query.value)}</p>}
      </div>
    </Dialog>
  );
}

const pages = (app: App): readonly Entry[] =>
  pagesOf(app).map(({ name, title }) => ({ kind: "page", title, run: () => void (location.hash = href(name)) }));

/** Those that have a key, by that key: the page that is shown does with it what it would. */
const actions = (): readonly Entry[] =>
  keyGroups()
    .flatMap(({ lines }) => lines)
    .flatMap<Entry>(({ keys: [key = ""], what }) =>
      key.length !== 1 || key === "/"
        ? []
        : [
            {
              kind: "action",
              title: what,
              about: key,
              run: () =>
                void requestAnimationFrame(() =>
                  document.body.dispatchEvent(new KeyboardEvent("keydown", { key: key.toLowerCase(), bubbles: true })),
                ),
            },
          ],
    );

/** Shown if they are hidden, and brought into sight. */
function panels(app: App, deps: Deps): readonly Entry[] {
  const { layout } = deps.viewState;
  return panelsOf(deps).map((panel) => ({
    kind: "panel",
    title: panel.title,
    about: isShown(layout.value, panel) ? "" : TEXT.hidden,
    run() {
      if (deps === app) go("live");
      sessionOf(app, deps.viewState).change((now) => show(now, panel, true));
      requestAnimationFrame(() =>
        document.querySelector(`[data-panel="${panel.id}"]`)?.scrollIntoView({ block: "nearest" }),
      );
    },
  }));
}

const devices = (app: App): readonly Entry[] =>
  app.store.devices.value.map((device) => ({
    kind: "device",
    title: fullName(device),
    about: device.serial_number,
    run() {
      select(app, device.id);
      go("live");
    },
  }));

const settings = (index: Index, typed: string, device: string | undefined): readonly Entry[] =>
  search(index, typed).map(({ kind, name, title, group, at }) => ({
    kind,
    title,
    about: group,
    run: () => go("configure", device, name, ...(at ? [at] : [])),
  }));

const files = (all: readonly RecordingInfo[], words: readonly string[]): readonly Entry[] =>
  all
    .filter((info) => recordingMatches(info, words))
    .map((info) => ({
      kind: "recording",
      title: recordingTitle(info),
      about: dateWords(info.started),
      run: () => go("recordings", info.id),
    }));

/** Signals that match, for a plot of their own; of two with one title each names its message. */
function signals({ store, viewState }: Deps, typed: string): readonly Entry[] {
  const { customPlots, view } = viewState;
  const rows = treeRows(store.devices.value, store.channels.value, new Set(), typed);
  return rows
    .filter(({ columns }) => columns.length > 0)
    .map((row) => ({
      kind: "signal",
      title: row.level === 3 ? `${row.channel?.info.title ?? ""} ${row.name}` : row.name,
      about: [fullName(row.device), row.channel?.info.group].filter(Boolean).join(" · "),
      run() {
        const { plots } = putOn(customPlots.peek(), [row], undefined, view.peek().device ?? "");
        if (plots) customPlots.value = plots;
      },
    }));
}
