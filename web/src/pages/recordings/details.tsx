/** One recording of the library: what is in it, what a person says of it, and what can be done with it. */
import { useSignal } from "@preact/signals";
import { bytes, dateWords, daysLeft, deviceName, isKnown, length, lostOf, messagesOf, rejectsOf, titleOf } from "../../recordings/library-filter";
import { server } from "../../recordings/api";
import type { RecordingInfo } from "../../recordings/types";
import { count, number } from "../../ui/format";
import { Icon } from "../../ui/icons";
import { Message } from "../../ui/message";
import { type App, run, select, sheet } from "../app-state";
import { go, href } from "../route";
import { exporting, Jobs } from "./export-dialog";
import { aboutToOpen, edit, remove, rename, undelete } from "./library-store";

export function Details({ info, app }: { readonly info: RecordingInfo; readonly app: App }) {
  return (
    <>
      <div class="head">
        <h2 class="ell">{titleOf(info)}</h2>
        <span class="grow" />
        {info.deleted === null && (
          <button type="button" class={`btn icon ${info.pinned ? "pinned" : ""}`} aria-pressed={info.pinned} aria-label="Pin: never culled by a quota" title="Pin: it is never culled by a quota" onClick={() => void edit(info.id, { pinned: !info.pinned })}>
            <Icon name="pin" />
          </button>
        )}
        {sheet.value === "side" && (
          <button type="button" class="btn icon" aria-label="Close the details" onClick={() => (sheet.value = undefined)}>
            <Icon name="close" />
          </button>
        )}
      </div>
      <div class="detail">
        {info.damaged !== "" && (
          <p class="problem">
            <b>Damaged.</b> <Message text={info.damaged} />
          </p>
        )}
        {info.deleted === null ? <Actions info={info} /> : <Deleted info={info} app={app} />}
        <Facts info={info} />
        {info.deleted === null && <Words info={info} />}
        <Jobs app={app} recording={info.id} />
      </div>
    </>
  );
}

function Actions({ info }: { readonly info: RecordingInfo }) {
  if (info.recording) return <p class="hint">It is being recorded now. It opens when the recording ends.</p>;
  const play = async (): Promise<void> => {
    const devices = await run(server.play(info.id, { speed: 1, loop: true, t0: null, t1: null }));
    const [first] = devices ?? [];
    if (!first) return;
    select(first.id);
    go("live");
  };
  return (
    <div class="acts">
      <a class="btn main" href={href("recordings", info.id)} {...aboutToOpen(info)}>
        <Icon name="wave" />
        Open
      </a>
      <a class="btn edge" href={server.downloadUrl(info.id)} download="" title="One file with everything in it; another imuscope opens it">
        <Icon name="download" />
        Download
      </a>
      <button type="button" class="btn edge" onClick={() => (exporting.value = { info, detail: undefined, ranges: [], first: info.started ?? 0, base: "device" })}>
        <Icon name="share" />
        Export…
      </button>
      <button type="button" class="btn edge" title="Play it again and again as a device that everybody sees" onClick={() => void play()}>
        <Icon name="play" />
        Play as a device
      </button>
      <button type="button" class="btn edge" title="Can be restored for 7 days" onClick={() => void remove(info)}>
        <Icon name="trash" />
        Delete
      </button>
    </div>
  );
}

function Deleted({ info, app }: { readonly info: RecordingInfo; readonly app: App }) {
  const days = daysLeft(info.deleted ?? 0, app.store.serverNow());
  return (
    <>
      <p class="hint">Deleted. It is kept for {count(days, "more day", "more days")}.</p>
      <div class="acts">
        <button type="button" class="btn main" onClick={() => void undelete(info.id)}>
          <Icon name="undo" />
          Put it back
        </button>
      </div>
    </>
  );
}

function Facts({ info }: { readonly info: RecordingInfo }) {
  const size = bytes(info.size);
  const known = isKnown(info);
  const rows: readonly (readonly [string, string, string])[] = [
    ["Recorded", info.started === null ? "not known" : `${dateWords(info.started, true)} UTC`, ""],
    ["Length", length(info.duration), ""],
    ["Size", size.value, size.unit],
    ["Messages", number(messagesOf(info), 0), ""],
    ["Lost", number(known ? lostOf(info) : undefined, 0), "samples"],
    ["Rejects", number(known ? rejectsOf(info) : undefined, 0), "frames"],
    ["Markers", number(info.markers, 0), ""],
  ];
  return (
    <>
      <dl class="facts">
        {rows.map(([name, value, unit]) => (
          <div key={name}>
            <dt>{name}</dt>
            <dd>
              {value}
              {unit && <span class="u">{unit}</span>}
            </dd>
          </div>
        ))}
      </dl>
      <h3>Devices</h3>
      <ul class="recdevs">
        {info.devices.map((device) => (
          <li key={device.id}>
            <b title={deviceName(device)}>{deviceName(device)}</b>
            <span class="mid">
              {number(device.messages ?? undefined, 0)}
              <span class="u">messages</span>
            </span>
            {device.lost > 0 && <span class="tag warn">{number(device.lost, 0)} lost</span>}
          </li>
        ))}
      </ul>
    </>
  );
}

const stem = (file: string): string => file.replace(/\.[^.]*$/, "");

/** What is refused is told in a band; the field says what the file is called. */
async function renamed(field: HTMLInputElement, info: RecordingInfo): Promise<void> {
  await rename(info.id, field.value);
  if (field.isConnected) field.value = stem(info.file);
}

function Words({ info }: { readonly info: RecordingInfo }) {
  const tag = useSignal("");
  const add = (event: Event): void => {
    event.preventDefault();
    const word = tag.value.trim();
    if (word !== "" && !info.tags.includes(word)) void edit(info.id, { tags: [...info.tags, word] });
    tag.value = "";
  };
  return (
    <div class="words">
      <label>
        <span>Name</span>
        <span class="field">
          <input defaultValue={info.title === info.id ? "" : info.title} placeholder={titleOf(info)} maxLength={200} onChange={(event) => void edit(info.id, { title: event.currentTarget.value })} />
        </span>
      </label>
      <label title="Its file in the folder. Links to the recording carry this name.">
        <span>File</span>
        <span class="field">
          <input key={info.file} defaultValue={stem(info.file)} maxLength={120} onChange={(event) => void renamed(event.currentTarget, info)} />
          <span class="u">{info.file.slice(stem(info.file).length)}</span>
        </span>
      </label>
      <label>
        <span>Notes</span>
        <textarea rows={3} defaultValue={info.notes} maxLength={10_000} onChange={(event) => void edit(info.id, { notes: event.currentTarget.value })} />
      </label>
      <form onSubmit={add}>
        <label>
          <span>Tags</span>
          <span class="field">
            <input value={tag.value} maxLength={40} placeholder="Add a tag, Enter" onInput={(event) => (tag.value = event.currentTarget.value)} />
          </span>
        </label>
        <span class="tags">
          {info.tags.map((word) => (
            <button type="button" key={word} class="tag line" aria-label={`Take the tag ${word} away`} title="Take it away" onClick={() => void edit(info.id, { tags: info.tags.filter((one) => one !== word) })}>
              {word} ×
            </button>
          ))}
        </span>
      </form>
    </div>
  );
}
