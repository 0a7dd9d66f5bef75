/** One recording of the library: its content, the user's notes, and its actions. */
import type { RecordingProps } from "./library";
import { useSignal } from "@preact/signals";
import {
  bytes,
  dateWords,
  daysLeft,
  deviceName,
  isKnown,
  knownDevices,
  knownLosses,
  recordedLosses,
  length,
  messagesOf,
  rejectsOf,
  recordingTitle,
} from "../../recordings/library-filter";
import { recordingsApi } from "../../recordings/api";
import type { RecordingInfo } from "../../wire/recording-types";
import { Button } from "../../ui/controls/button";
import { number } from "../../ui/format/format";
import { IconButton } from "../../ui/controls/icon-button";
import { Icon } from "../../ui/controls/icons";
import { Hint } from "../../ui/controls/card";
import { Message } from "../../ui/controls/message";
import type { App } from "../../page/context";
import { Slot } from "../../extension/extension";
import { href } from "../../page/route";
import { exportingOf } from "../../recordings/exporting";
import { Jobs } from "./export-jobs";
import { type Library, libraryOf } from "./library-store";
import { playAsDevice } from "./share-menu";
import { isViewOnly } from "../../wire/capabilities";
import { SimulatedTag } from "../../ui/controls/simulated-tag";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/recordings";

declare module "../../extension/extension" {
  interface Slots {
    /** Under the facts of a recording that is selected. */
    readonly recordingDetails: RecordingProps;
  }
}

export function RecordingDetails({ info, app }: { readonly info: RecordingInfo; readonly app: App }) {
  const library = libraryOf(app);
  return (
    <>
      <div class="head">
        <h2 class="ellipsis">{recordingTitle(info)}</h2>
        <span class="grow" />
        {info.deleted === null && (
          <IconButton
            changes
            class={info.pinned ? "pinned" : ""}
            icon="pin"
            aria-pressed={info.pinned}
            label={TEXT.pin}
            title={TEXT.pinHint}
            onClick={() => library.edit(info, () => ({ pinned: !info.pinned }))}
          />
        )}
        {app.sheet.value === "side" && (
          <IconButton icon="close" label={TEXT.closeDetails} onClick={() => (app.sheet.value = undefined)} />
        )}
      </div>
      <div class="detail">
        {info.damaged !== "" && (
          <p class="problem">
            <b>{TEXT.damaged}</b> <Message text={info.damaged} />
          </p>
        )}
        {info.deleted === null ? <Actions info={info} app={app} /> : <Deleted info={info} app={app} />}
        <Facts info={info} />
        {info.remark !== "" && <Hint text={info.remark} />}
        <Slot name="recordingDetails" with={{ app, info }} />
        {info.deleted === null && <Words library={library} info={info} />}
        <Jobs app={app} recording={info.id} />
      </div>
    </>
  );
}

function Actions({ info, app }: { readonly info: RecordingInfo; readonly app: App }) {
  const library = libraryOf(app);
  if (info.recording) return <p class="hint">{TEXT.recordingInProgress}</p>;
  return (
    <div class="actions">
      <a class="btn main" href={href("recordings", info.id)} {...library.aboutToOpen(info)}>
        <Icon name="wave" />
        {COMMON.open}
      </a>
      <a class="btn edge" href={recordingsApi.downloadUrl(info.id)} download="" title={TEXT.downloadHint}>
        <Icon name="download" />
        {COMMON.download}
      </a>
      <Button
        changes
        look="edge"
        icon="share"
        words={TEXT.export}
        onClick={() =>
          (exportingOf(app).value = { info, detail: undefined, ranges: [], first: info.started ?? 0, base: "device" })
        }
      />
      <Button
        changes
        look="edge"
        icon="play"
        words={TEXT.playAsDevice}
        title={TEXT.playLoopHint}
        onClick={() => void playAsDevice(app, info.id, { speed: 1, loop: true, t0: null, t1: null })}
      />
      <Button
        changes
        look="edge"
        icon="trash"
        words={COMMON.delete}
        title={TEXT.canBeRestoredFor7Days}
        onClick={() => void library.remove(info)}
      />
    </div>
  );
}

function Deleted({ info, app }: { readonly info: RecordingInfo; readonly app: App }) {
  return (
    <>
      <p class="hint">{TEXT.deletedKeptFor(daysLeft(info.deleted ?? 0, app.store.serverNow()))}</p>
      <div class="actions">
        <Button
          changes
          look="main"
          icon="undo"
          words={TEXT.restore}
          onClick={() => void libraryOf(app).undelete(info.id)}
        />
      </div>
    </>
  );
}

function Facts({ info }: { readonly info: RecordingInfo }) {
  const size = bytes(info.size);
  const devices = knownDevices(info);
  const rows: readonly (readonly [string, string, string])[] = [
    [TEXT.recorded, info.started === null ? TEXT.unknown : TEXT.timeUtc(dateWords(info.started, true)), ""],
    [TEXT.length, length(info.duration), ""],
    [TEXT.size, size.value, size.unit],
    [TEXT.messages, isKnown(info) ? number(messagesOf(info), 0) : TEXT.notReadYet, ""],
    [COMMON.lost, recordedLosses(info), knownLosses(info) ? TEXT.samples : ""],
    [
      COMMON.rejects,
      ...(isKnown(info) ? ([number(rejectsOf(info), 0), TEXT.frames] as const) : ([TEXT.notReadYet, ""] as const)),
    ],
    [COMMON.markers, number(info.markers, 0), ""],
  ];
  return (
    <>
      <dl class="fact-list">
        {rows.map(([name, value, unit]) => (
          <div key={name}>
            <dt>
              <span {...(name === COMMON.lost ? { "data-about": "time", "data-recording": info.id } : {})}>{name}</span>
            </dt>
            <dd>
              {value}
              {unit && <span class="unit">{unit}</span>}
            </dd>
          </div>
        ))}
      </dl>
      {devices.length > 0 && <h3>{COMMON.devices}</h3>}
      <ul class="recording-devices">
        {devices.map((device) => (
          <li key={device.id}>
            <b class="ellipsis" title={deviceName(device)}>
              {deviceName(device)}
            </b>
            <SimulatedTag of={device} />
            <span class="mid">
              {number(device.messages ?? undefined, 0)}
              <span class="unit">{TEXT.messagesUnit}</span>
            </span>
            {device.lost === 0 && isKnown(info) && !device.counts_losses && (
              <span class="dim">{TEXT.lossesNotCounted}</span>
            )}
            {device.lost > 0 && (
              <span class="tag warn" data-about="time" data-recording={info.id}>
                {TEXT.lostCount(number(device.lost, 0))}
              </span>
            )}
          </li>
        ))}
      </ul>
    </>
  );
}

const stem = (file: string): string => file.replace(/\.[^.]*$/, "");

/** Rename the file; a refusal is shown in a band, and the field shows the present name. */
async function renamed(library: Library, field: HTMLInputElement, info: RecordingInfo): Promise<void> {
  await library.rename(info.id, field.value);
  if (field.isConnected) field.value = stem(info.file);
}

function Words({ library, info }: { readonly library: Library; readonly info: RecordingInfo }) {
  const tag = useSignal("");
  const add = (event: Event): void => {
    event.preventDefault();
    const word = tag.value.trim();
    if (word !== "") library.edit(info, ({ tags }) => ({ tags: [...new Set([...tags, word])] }));
    tag.value = "";
  };
  return (
    <div class="words">
      <label>
        <span>{COMMON.name}</span>
        <span class="field">
          <input
            disabled={isViewOnly.value}
            defaultValue={info.title === info.id ? "" : info.title}
            placeholder={recordingTitle(info)}
            maxLength={200}
            onChange={({ currentTarget: { value } }) => library.edit(info, () => ({ title: value }))}
          />
        </span>
      </label>
      <label title={TEXT.fileNameHint}>
        <span>{TEXT.file}</span>
        <span class="field">
          <input
            disabled={isViewOnly.value}
            key={info.file}
            defaultValue={stem(info.file)}
            maxLength={120}
            onChange={(event) => void renamed(library, event.currentTarget, info)}
          />
          <span class="unit">{info.file.slice(stem(info.file).length)}</span>
        </span>
      </label>
      <label>
        <span>{TEXT.notes}</span>
        <textarea
          disabled={isViewOnly.value}
          rows={3}
          defaultValue={info.notes}
          maxLength={10_000}
          onChange={({ currentTarget: { value } }) => library.edit(info, () => ({ notes: value }))}
        />
      </label>
      <form onSubmit={add}>
        <label>
          <span>{TEXT.tags}</span>
          <span class="field">
            <input
              disabled={isViewOnly.value}
              value={tag.value}
              maxLength={40}
              placeholder={TEXT.addTag}
              onInput={(event) => (tag.value = event.currentTarget.value)}
            />
          </span>
        </label>
        <span class="tags">
          {info.tags.map((word) => (
            <button
              disabled={isViewOnly.value}
              type="button"
              key={word}
              class="tag outlined"
              aria-label={TEXT.removeTag(word)}
              title={TEXT.removeTagHint}
              onClick={() => library.edit(info, ({ tags }) => ({ tags: tags.filter((one) => one !== word) }))}
            >
              {word} ×
            </button>
          ))}
        </span>
      </form>
    </div>
  );
}
