/** The library: every recording in the folder, newest first, with its metadata. */
import { useEffect, useRef } from "preact/hooks";
import {
  bytes,
  CATEGORIES,
  deviceName,
  knownDevices,
  inCategory,
  length,
  countedValues,
  recordingTitle,
} from "../../recordings/library-filter";
import type { LibraryStorage, RecordingInfo } from "../../wire/recording-types";
import { Button } from "../../ui/controls/button";
import { IconButton } from "../../ui/controls/icon-button";
import { SearchField } from "../../ui/controls/search-field";
import { Message } from "../../ui/controls/message";
import type { App } from "../../page/context";
import { TopBar } from "../top-bar";
import { OfflineBand, ProblemBand } from "../empty-states";
import { PageOverlays } from "../overlays";
import { RecordingDetails } from "./details";
import { ColumnMenu, RecordingList } from "./library-list";
import { SelectionBar } from "./selection-bar";
import { type Library, libraryOf } from "./library-store";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/recordings";

export interface RecordingProps {
  readonly app: App;
  readonly info: RecordingInfo;
}

declare module "../../extension/extension" {
  interface Slots {
    /** In the row of a recording, before its facts. */
    readonly recordingRow: RecordingProps;
  }
}

export function LibraryPage({ app }: { readonly app: App }) {
  const library = libraryOf(app);
  useEffect(() => library.follow(), [library]);
  useEffect(() => {
    document.title = TEXT.recordingsImuscope;
  }, []);
  const offline = app.store.connection.value === "closed" || app.store.silentSince.value !== undefined;
  return (
    <div class={`app library ${offline ? "offline" : ""}`}>
      <a class="btn edge skip" href="#list">
        {TEXT.skipToTheList}
      </a>
      <TopBar app={app} />
      {offline && <OfflineBand app={app} />}
      <Filters app={app} />
      <main class="library-centre flex-column" id="list" tabIndex={-1}>
        <h1 class="visually-hidden">{COMMON.recordings}</h1>
        <ProblemBand app={app} />
        <Tools app={app} />
        <Arrivals library={library} />
        <Gone library={library} />
        <RecordingList app={app} />
        <SelectionBar app={app} />
      </main>
      <aside class={`side ${app.sheet.value === "side" ? "open" : ""}`} id="side" aria-label={TEXT.thisRecording}>
        {library.several.value.length > 1 ? (
          <p class="foot-note dim padded">{TEXT.selectedCount(library.several.value.length)}</p>
        ) : library.current.value ? (
          <RecordingDetails key={library.current.value.id} info={library.current.value} app={app} />
        ) : (
          <p class="foot-note dim padded">{TEXT.selectRecording}</p>
        )}
      </aside>
      <PageOverlays app={app} />
    </div>
  );
}

function Filters({ app }: { readonly app: App }) {
  const { sheet } = app;
  const library = libraryOf(app);
  const list = library.all.value ?? [];
  const kept = list.filter(({ deleted }) => deleted === null);
  const { category, device, tag } = library.choice.value;
  const devices = countedValues(kept.flatMap((info) => [...new Set(knownDevices(info).map(deviceName))]));
  const tags = countedValues(kept.flatMap((info) => info.tags));
  return (
    <aside class={`rail ${sheet.value === "rail" ? "open" : ""}`} id="rail" aria-label={TEXT.filters}>
      <div class="head">
        <h2>{TEXT.library}</h2>
        <span class="grow" />
        {sheet.value === "rail" && (
          <IconButton icon="close" label={TEXT.closeTheFilters} onClick={() => (sheet.value = undefined)} />
        )}
      </div>
      <div class="categories" role="group" aria-label={TEXT.recordingFilter}>
        {CATEGORIES.map(({ name, title }) => (
          <Filter
            key={name}
            title={title}
            n={list.filter((info) => inCategory(info, name)).length}
            on={category === name}
            set={() => library.choose({ category: name })}
          />
        ))}
      </div>
      {devices.length > 0 && (
        <>
          <div class="head further">
            <h3>{COMMON.device}</h3>
          </div>
          <div class="categories" role="group" aria-label={COMMON.device}>
            {devices.map(([name, n]) => (
              <Filter
                key={name}
                title={name}
                n={n}
                on={device === name}
                set={() => library.choose({ device: device === name ? "" : name })}
              />
            ))}
          </div>
        </>
      )}
      {tags.length > 0 && (
        <>
          <div class="head further">
            <h3>{TEXT.tag}</h3>
          </div>
          <div class="tag-cloud flex-wrap" role="group" aria-label={TEXT.tag}>
            {tags.map(([name, n]) => (
              <button
                type="button"
                key={name}
                class="tag outlined"
                aria-pressed={tag === name}
                onClick={() => library.choose({ tag: tag === name ? "" : name })}
              >
                {name} {n}
              </button>
            ))}
          </div>
        </>
      )}
      <Storage of={library.storage.value} />
    </aside>
  );
}

/** Disk space, at the foot of the filters. */
function Storage({ of }: { readonly of: LibraryStorage | undefined }) {
  if (of === undefined) return null;
  const words = (n: number): string => {
    const { value, unit } = bytes(n);
    return `${value} ${unit}`;
  };
  const most = of.quota > 0 ? Math.min(of.quota, of.used + of.free) : of.used + of.free;
  return (
    <div class="storage">
      <span>{TEXT.diskUsed(words(of.used))}</span>
      <span>{TEXT.diskFree(words(of.free))}</span>
      {of.quota > 0 && <span class="quota">{TEXT.quotaOf(words(of.quota))}</span>}
      <progress value={of.used} max={most} aria-label={TEXT.diskShare} />
    </div>
  );
}

interface FilterProps {
  readonly title: string;
  readonly n: number;
  readonly on: boolean;
  readonly set: () => void;
}

function Filter({ title, n, on, set }: FilterProps) {
  return (
    <button type="button" aria-pressed={on} onClick={set}>
      <span class="ellipsis">{title}</span>
      <span class="count">{n}</span>
    </button>
  );
}

function Tools({ app }: { readonly app: App }) {
  const library = libraryOf(app);
  const files = useRef<HTMLInputElement>(null);
  const list = library.shown.value;
  const seconds = list.reduce((sum, { duration }) => sum + (duration ?? 0), 0);
  const take = (): void => {
    void library.add([...(files.current?.files ?? [])]);
    if (files.current) files.current.value = "";
  };
  return (
    <div class="tools flex-row">
      <SearchField
        label={TEXT.search}
        placeholder={TEXT.nameNoteTagDeviceDate}
        value={library.choice.value.query}
        onText={(query) => library.choose({ query })}
        hasKey
      />
      <Button look="edge icon phone" icon="list" aria-label={TEXT.filters} onClick={() => (app.sheet.value = "rail")} />
      <span class="grow desk" />
      <span class="dim desk total">
        {library.all.value !== undefined && TEXT.recordingCount(list.length)}
        {seconds > 0 && ` · ${length(seconds)}`}
      </span>
      <ColumnMenu library={library} />
      <Button
        look="edge phone"
        words={library.isPicking.value ? COMMON.cancel : TEXT.select}
        aria-pressed={library.isPicking.value}
        onClick={() => {
          const isBegun = !library.isPicking.peek();
          library.pickAll([]);
          library.isPicking.value = isBegun;
        }}
      />
      <input ref={files} type="file" multiple hidden onChange={take} aria-label={TEXT.filesToAdd} />
      <Button
        changes
        look="edge"
        icon="upload"
        aria-label={TEXT.addFiles}
        title={TEXT.addFilesHint}
        onClick={() => files.current?.click()}
      >
        <span class="desk">{TEXT.addFiles}</span>
      </Button>
    </div>
  );
}

function Arrivals({ library }: { readonly library: Library }) {
  const { coming } = library;
  if (coming.value.length === 0) return null;
  return (
    <ul class="incoming" aria-label={TEXT.filesBeingAdded}>
      {coming.value.map(({ key, name, share, problem, cancel }) => (
        <li key={key}>
          <b class="ellipsis">{name}</b>
          {problem ? (
            <span class="why mid" role="alert">
              <span class="dot bad" /> <Message text={problem.message} /> <Message text={problem.hint} />
            </span>
          ) : (
            <progress value={share} max={1} aria-label={`${name}: ${Math.round(100 * share)} %`} />
          )}
          <IconButton
            icon="close"
            label={problem ? TEXT.dismissFile(name) : TEXT.doNotAdd(name)}
            onClick={() => (problem ? library.dismiss(key) : cancel())}
          />
        </li>
      ))}
    </ul>
  );
}

function Gone({ library }: { readonly library: Library }) {
  const { gone } = library;
  const [first, ...more] = gone.value;
  if (!first) return null;
  const name = more.length > 0 ? TEXT.recordingCount(more.length + 1) : recordingTitle(first);
  return (
    <div class="band calm" role="status">
      <b class="ellipsis">{TEXT.recordingDeleted(name)}</b>
      <span class="mid">{TEXT.restorableFor7Days}</span>
      <span class="grow" />
      <Button
        changes
        look="edge"
        icon="undo"
        words={TEXT.undo}
        onClick={() => void library.undelete(...gone.peek().map(({ id }) => id))}
      />
      <IconButton icon="close" label={COMMON.close} onClick={() => (gone.value = [])} />
    </div>
  );
}
