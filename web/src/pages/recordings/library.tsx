/** The library: every recording in the folder, newest first, with its metadata. */
import { useEffect, useRef } from "preact/hooks";
import {
  bytes,
  CATEGORIES,
  dateWords,
  deviceName,
  knownDevices,
  flaw,
  inCategory,
  length,
  countedValues,
  recordingTitle,
} from "../../recordings/library-filter";
import type { RecordingInfo } from "../../wire/recording-types";
import { Button } from "../../ui/controls/button";
import { Card } from "../../ui/controls/card";
import { IconButton } from "../../ui/controls/icon-button";
import { Icon } from "../../ui/controls/icons";
import { SearchField } from "../../ui/controls/search-field";
import { Message } from "../../ui/controls/message";
import type { App } from "../../page/context";
import { Slot } from "../../extension/extension";
import { TopBar } from "../top-bar";
import { go, href } from "../../page/route";
import { OfflineBand, ProblemBand } from "../empty-states";
import { PageOverlays } from "../overlays";
import { RecordingDetails } from "./details";
import { type Library, libraryOf } from "./library-store";
import { TableHead } from "../../ui/controls/table-head";
import { SimulatedTag } from "../../ui/controls/simulated-tag";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/recordings";
import { css, surface } from "../../ui/dom/canvas";
import { theme } from "../../ui/dom/theme";

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
        <List app={app} />
      </main>
      <aside class={`side ${app.sheet.value === "side" ? "open" : ""}`} id="side" aria-label={TEXT.thisRecording}>
        {library.current.value ? (
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
    </aside>
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
        {seconds > 0 && ` · ${length(seconds)}`} {TEXT.newestFirst}
      </span>
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
  const deleted = gone.value;
  if (!deleted) return null;
  return (
    <div class="band calm" role="status">
      <b class="ellipsis">{TEXT.recordingDeleted(recordingTitle(deleted))}</b>
      <span class="mid">{TEXT.restorableFor7Days}</span>
      <span class="grow" />
      <Button changes look="edge" icon="undo" words={TEXT.undo} onClick={() => void library.undelete(deleted.id)} />
      <IconButton icon="close" label={COMMON.close} onClick={() => (gone.value = undefined)} />
    </div>
  );
}

function List({ app }: { readonly app: App }) {
  const { all, shown, trouble } = libraryOf(app);
  if (trouble.value && all.value === undefined)
    return <Card title={TEXT.theListCouldNotBeLoaded} message={`${trouble.value.message} ${trouble.value.hint}`} />;
  if (all.value === undefined) return <div class="recording-list" aria-busy="true" />;
  if (all.value.length === 0) return <Card title={TEXT.noRecordingYet} message={TEXT.noRecordingHint} />;
  if (shown.value.length === 0) return <Card title={TEXT.noMatches} message={TEXT.noMatchesHint} />;
  return (
    <div class="recording-list" tabIndex={0} role="region" aria-label={COMMON.recordings}>
      <table>
        <caption class="visually-hidden">{TEXT.recordingsNewestFirst}</caption>
        <colgroup>
          {["motion", "name", "devices", "length", "size", "loss", "tags"].map((name) => (
            <col key={name} class={name} />
          ))}
        </colgroup>
        <TableHead
          of={[
            ...[TEXT.motion, TEXT.recording, COMMON.devices],
            ...[TEXT.length, TEXT.size].map((text) => ({ text, class: "num" })),
            ...[COMMON.loss, TEXT.tags],
          ]}
        />
        <tbody>
          {shown.value.map((info) => (
            <Row key={info.id} info={info} app={app} />
          ))}
        </tbody>
      </table>
    </div>
  );
}

function Row({ info, app }: { readonly info: RecordingInfo; readonly app: App }) {
  const library = libraryOf(app);
  const { selected } = library;
  const { tone, words } = flaw(info);
  const size = bytes(info.recording ? (app.store.recorder.value?.bytes ?? info.size) : info.size);
  const pick = (): void => {
    selected.value = info.id;
  };
  const devices = knownDevices(info)
    .map(({ name, product }) => name || product)
    .join(" + ");
  const about = info.damaged || info.notes || info.file;
  const open = !info.recording && info.deleted === null;
  return (
    <tr
      class={selected.value === info.id ? "on" : ""}
      onClick={pick}
      onDblClick={() => open && go("recordings", info.id)}
    >
      <td>
        <Thumb info={info} />
      </td>
      <td>
        <b class="ellipsis">
          {open ? (
            <a href={href("recordings", info.id)} {...library.aboutToOpen(info)}>
              {recordingTitle(info)}
            </a>
          ) : (
            recordingTitle(info)
          )}
          {info.pinned && <Icon name="pin" />}
        </b>
        <small class="ellipsis">
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
      </td>
      <td class="mid device-list" title={devices}>
        <span>{devices || "—"}</span>
      </td>
      <td class="num">
        {length(info.duration)}
        <small>{dateWords(info.started)}</small>
      </td>
      <td class="num">
        {size.value}
        <span class="unit">{size.unit}</span>
      </td>
      <td>{tone === "" ? <span class="dim">{words}</span> : <span class={`tag ${tone}`}>{words}</span>}</td>
      <td>
        <span class="tags">
          {info.tags.map((tag) => (
            <span class="tag outlined" key={tag}>
              {tag}
            </span>
          ))}
        </span>
        <IconButton
          icon="dots"
          label={TEXT.detailsOf(recordingTitle(info))}
          class="phone show-details"
          onClick={() => {
            pick();
            app.sheet.value = "side";
          }}
        />
      </td>
    </tr>
  );
}

/** A loss is never narrower than this, px. */
const LOSS_PX = 2;

function Thumb({ info }: { readonly info: RecordingInfo }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const { thumbnail, losses } = info;
  const look = theme.value;
  useEffect(() => {
    if (!canvas.current) return undefined;
    const to = surface(canvas.current, draw);
    function draw(): void {
      if (!to.begin()) return;
      const [x, width, height] = [to.context, to.width(), to.height()];
      const step = width / Math.max(1, thumbnail.length);
      x.fillStyle = css("--ink-2");
      thumbnail.forEach((pair, i) => {
        const [a, b] = [pair[0] ?? 0, pair[1] ?? pair[0] ?? 0];
        const tall = Math.max(1.5, Math.max(a, b) * (height - 4));
        x.fillRect(i * step, (height - tall) / 2, Math.max(0.8, step * 0.7), tall);
      });
      if (thumbnail.length === 0) x.fillRect(0, height / 2 - 0.75, width, 1.5);
      x.fillStyle = css("--loss");
      for (const at of losses) x.fillRect(Math.min(width - LOSS_PX, at * width), 1, LOSS_PX, height - 2);
    }
    draw();
    return () => to.dispose();
  }, [thumbnail, losses, look]);
  const lost = losses.length === 0 ? "" : TEXT.lostInPlaces(losses.length);
  return (
    <div class="thumbnail">
      <canvas ref={canvas} role="img" aria-label={TEXT.motionOverTheRecording(lost)} />
    </div>
  );
}
