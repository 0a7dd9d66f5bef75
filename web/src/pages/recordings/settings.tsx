/** Settings of a device at the time of recording, beside its present ones. */
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { dateWords, recordingTitle } from "../../recordings/library-filter";
import type { ReplayController } from "../../recordings/replay-controller";
import { recordingsApi as recordings } from "../../recordings/api";
import type { RecordedSettings } from "../../wire/recording-types";
import { Button } from "../../ui/controls/button";
import { Dialog } from "../../ui/controls/dialog";
import { Hint } from "../../ui/controls/card";
import type { DeviceInfo } from "../../wire/types";
import { run } from "../../page/app-state";
import type { App } from "../../page/context";
import { configureApi } from "../configure/api";
import type { OpenRecording } from "./open-recording";
import { go } from "../../page/route";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/recordings";

type Fields = Readonly<Record<string, unknown>>;

/** Format of server/library/recording_session.py for a device; files in another format show nothing. */
interface Settings {
  readonly values: Readonly<Record<string, Fields>>;
  readonly missing: Readonly<Record<string, string>>;
  readonly about: Readonly<Record<"protocol" | "product" | "serial_number" | "firmware" | "reason", string>>;
  readonly taken: number | null;
}

const isFields = (value: unknown): value is Fields =>
  typeof value === "object" && value !== null && !Array.isArray(value);
const words = (value: unknown): string => (typeof value === "string" ? value : "");

function settingsOf(replay: ReplayController, device: string | undefined): Settings | undefined {
  const snapshot = replay.detail.snapshots[device ?? ""];
  if (!snapshot || !isFields(snapshot["values"])) return undefined;
  const values = Object.fromEntries(
    Object.entries(snapshot["values"]).filter((pair): pair is [string, Fields] => isFields(pair[1])),
  );
  if (Object.keys(values).length === 0) return undefined;
  const missing = isFields(snapshot["missing"])
    ? Object.fromEntries(Object.entries(snapshot["missing"]).map(([name, why]) => [name, words(why)]))
    : {};
  const of = (name: string): string => words(snapshot[name]);
  const about = {
    protocol: of("protocol"),
    product: of("product"),
    serial_number: of("serial_number"),
    firmware: of("firmware"),
    reason: of("reason"),
  };
  return { values, missing, about, taken: typeof snapshot["taken"] === "number" ? snapshot["taken"] : null };
}

/** The device itself, if it is connected now. */
function presentOf(app: App, { about }: Settings): DeviceInfo | undefined {
  const same = app.store.devices.value.filter(
    ({ protocol, status, link }) => protocol === about.protocol && status === "live" && link !== "file",
  );
  return (
    same.find(({ serial_number: serial }) => about.serial_number !== "" && serial === about.serial_number) ??
    (about.serial_number === "" ? same[0] : undefined)
  );
}

/** A line of the sidebar; absent if no settings were recorded. */
export function SettingsLine({ recording }: { readonly recording: OpenRecording }) {
  const { replay, showsSettings } = recording;
  const settings = settingsOf(replay, replay.viewState.device.value);
  if (!settings) return null;
  return (
    <div class="apply-as-settings flex-row mid text-sm">
      <span>{COMMON.settings}</span>
      <Button
        look="edge"
        icon="sliders"
        words={TEXT.asRecorded}
        title={TEXT.asRecordedHint}
        onClick={() => (showsSettings.value = true)}
      />
    </div>
  );
}

export function SettingsDialog({ recording }: { readonly recording: OpenRecording }) {
  const { replay, app, showsSettings } = recording;
  const settings = showsSettings.value ? settingsOf(replay, replay.viewState.device.value) : undefined;
  if (!settings) return null;
  const present = presentOf(app, settings);
  const { about, taken } = settings;
  const close = (): void => {
    showsSettings.value = false;
  };
  const compare = async (to: DeviceInfo): Promise<void> => {
    const kept = await run(
      app,
      configureApi.keepSnapshot(
        to.id,
        TEXT.recordingTitle(recordingTitle(replay.detail.info)).slice(0, 120),
        asText(settings),
      ),
    );
    close();
    if (kept) go("configure", to.id, "compare", kept.name);
  };
  return (
    <Dialog title={TEXT.settingsAsRecorded} onClose={close}>
      <div class="recorded-settings">
        <p class="dim">
          {[
            about.product,
            about.serial_number,
            about.firmware && COMMON.firmware(about.firmware),
            about.reason,
            taken !== null && TEXT.timeUtc(dateWords(taken, true)),
          ]
            .filter(Boolean)
            .join(" · ")}
        </p>
        {present ? (
          <Button look="main" icon="sliders" title={TEXT.compareHint} onClick={() => void compare(present)}>
            <span class="ellipsis">{TEXT.compareWithNow(present.name)}</span>
          </Button>
        ) : (
          <p class="hint">{TEXT.compareUnavailable}</p>
        )}
        <Values recording={replay.detail.info.id} device={replay.viewState.device.value ?? ""} />
      </div>
    </Dialog>
  );
}

/** All settings in the form of Configure, group by group. */
function Values({ recording, device }: { readonly recording: string; readonly device: string }) {
  const settingsAnswer = useSignal<RecordedSettings | undefined>(undefined);
  const why = useSignal("");
  useEffect(() => {
    void recordings.settings(recording, device).then((outcome) => {
      if (outcome.ok) settingsAnswer.value = outcome.value;
      else why.value = `${outcome.problem.message} ${outcome.problem.hint}`;
    });
  }, [recording, device]);
  if (why.value !== "") return <Hint text={why.value} />;
  if (settingsAnswer.value === undefined)
    return (
      <p class="hint" aria-busy="true">
        {TEXT.readingRecordedSettings}
      </p>
    );
  const { settings, missing } = settingsAnswer.value;
  const without = Object.keys(missing);
  return (
    <>
      {[...new Set(settings.map(({ group }) => group))].map((group) => (
        <section key={group} aria-label={group}>
          <h3>{group}</h3>
          <dl>
            {settings
              .filter((one) => one.group === group)
              .map(({ name, title, rows }) => (
                <div key={name}>
                  <dt>{title}</dt>
                  <dd>
                    {rows.map((row, k) => (
                      <span key={k}>
                        {row.title !== "" && <small>{row.title}</small>} {row.words}
                      </span>
                    ))}
                  </dd>
                </div>
              ))}
          </dl>
        </section>
      ))}
      {without.length > 0 && <p class="hint">{TEXT.settingsNotRead(without.length, without.join(", "))}</p>}
    </>
  );
}

/** In the format of a snapshot file (server/configuration/snapshots.py): JSON is YAML. */
function asText({ values, missing, about, taken }: Settings): string {
  const { reason: _, ...rest } = about;
  return JSON.stringify({
    imuscope: 1,
    title: "",
    taken: new Date(1000 * (taken ?? 0)).toISOString(),
    reason: "",
    ...rest,
    pinned: false,
    settings: values,
    missing,
  });
}
