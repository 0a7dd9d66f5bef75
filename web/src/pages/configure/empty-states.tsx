/** Placeholders and bands of a form: reading, never read, lost, not permitted, no settings. */
import { isOver, JobLine, jobOf, StopJob } from "./jobs";
import type { App } from "../../page/context";
import { ResumeButton } from "../empty-states";
import type { Model } from "./model";
import { linkTo, pauseOf, readAll, unfinishedOf } from "./view-state";
import { Button } from "../../ui/controls/button";
import { Band } from "../../ui/controls/band";
import { Card } from "../../ui/controls/card";
import { clock, NONE } from "../../ui/format/format";
import { request } from "../../requests/http";
import { Message } from "../../ui/controls/message";
import { useAnswer } from "../../requests/use-answer";
import { isViewOnly } from "../../wire/capabilities";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/configure";
import { TEXT as FORMS } from "../../texts/forms";
import { keyedList } from "../../forms/edits";
import type { RemoteChange } from "../../forms/rebase";
import type { FieldForm, Forms } from "../../wire/form-types";
import { at, joined, type FormValues, whereOf, valueWords } from "../../forms/values";

const ASK_EVERY_MS = 1000;

/** Programs that have the shared port of the device open. */
function useOtherPrograms(model: Model): readonly string[] {
  const path = { device: model.id };
  const { answer } = useAnswer(model.id, () => request("GET /api/devices/{device}/shares", { path }), {
    everyMs: ASK_EVERY_MS,
  });
  const clients = answer?.shares.flatMap((share) => share.clients) ?? [];
  return [...new Set(clients.map(({ name }) => name))];
}

export function NotRead({ model }: { readonly model: Model }) {
  const device = model.device.value;
  const last = model.jobs.value?.done[0];
  const users = useOtherPrograms(model);
  const failed = model.lastRead.value === undefined ? undefined : jobOf(model, model.lastRead.value);
  const use = users.length > 0 ? TEXT.alsoUsedBy(users.join(", ")) : "";
  return (
    <Card
      title={TEXT.notReadYet}
      dot="off"
      message={TEXT.settingsUnknown(device?.name ?? COMMON.theDevice)}
      hint={`${use} ${pauseOf(model)}`.trim()}
    >
      {failed && isOver(failed) && failed.state !== "done" && last?.id === failed.id && (
        <JobLine model={model} id={failed.id} />
      )}
      <div class="row">
        <Button changes look="main" words={TEXT.readSettings} onClick={() => readAll(model)} />
      </div>
    </Card>
  );
}

export function ReadingNote({ model }: { readonly model: Model }) {
  const job = model.jobs.value?.running;
  if (!job) return null;
  return (
    <Card title={job.title} dot="live" message={job.step || TEXT.readingSettings} role="status">
      <div class="row">
        <StopJob model={model} job={job} />
      </div>
    </Card>
  );
}

/** No forms: the protocol is unknown, or has no settings, or the server does not provide them. */
export function NoForms({ model }: { readonly model: Model }) {
  const device = model.device.value;
  const problem = model.problem.value;
  const [title, message] = problem
    ? [TEXT.noSettingsToShow, problem.message]
    : device?.protocol
      ? [TEXT.loadingForms, TEXT.formsLoading]
      : [TEXT.protocolUnknown, TEXT.waitingForProtocol];
  return (
    <Card title={title} dot={problem ? "bad" : "off"} message={message} hint={problem?.hint || device?.message}>
      <div class="row">
        <Button look="main" words={TEXT.tryAgain} onClick={() => void model.load()} />
      </div>
    </Card>
  );
}

export function ViewOnlyBand() {
  if (!isViewOnly.value) return null;
  return (
    <Band tone="calm" dot="off" title={COMMON.viewOnly}>
      <span class="grow">{TEXT.viewTokenHint}</span>
    </Band>
  );
}

export function LostBand({ app, model }: { readonly app: App; readonly model: Model }) {
  const device = model.device.value;
  if (!device || device.status === "live") return null;
  if (device.status === "idle") {
    if (device.message === "") return null;
    return (
      <Band tone="calm" dot="off" title={COMMON.idle} data-key="quiet">
        <span class="grow">
          <Message text={device.message} /> {device.quiet_since ? COMMON.quietSince(clock(device.quiet_since)) : ""}{" "}
          <Message text={device.hint} />
        </span>
        {device.resume && <ResumeButton app={app} device={device} />}
      </Band>
    );
  }
  if (model.jobs.value?.pending_rollback?.state === "unreachable") return null; // the deck says more
  const isConnecting = device.status === "connecting";
  const title = { lost: COMMON.lost, denied: COMMON.notPermitted, ended: COMMON.ended, connecting: COMMON.connecting }[
    device.status
  ];
  return (
    <Band tone={isConnecting ? "calm" : undefined} role="status" dot={isConnecting ? "off" : "bad"} title={title}>
      <span class="grow">
        <Message text={device.message} /> <Message text={device.hint} /> {TEXT.lastReadValues}
      </span>
      {device.status === "lost" && (model.forms.value?.settings.length ?? 0) > 0 && (
        <a class="btn small edge" href={linkTo(model, "restore")}>
          {TEXT.restoreCommunication}
        </a>
      )}
    </Band>
  );
}

/** Settings that the last reading did not get, each with the device's reason. */
export function UnreadSettings({ model }: { readonly model: Model }) {
  const missing = Object.entries(model.body.value?.missing ?? {});
  if (missing.length === 0 || !model.isRead.value) return null;
  return (
    <details class="hint inset unread-settings">
      <summary>{TEXT.unreadSettings(missing.length)}</summary>
      <ul>
        {missing.map(([name, why]) => (
          <li key={name}>
            {model.setting(name)?.title ?? name}: <span class="dim">{why}</span>
          </li>
        ))}
      </ul>
    </details>
  );
}

/** Which sensor this is, where that is in doubt: another one has come, or may have. */
export function SensorBand({ model }: { readonly model: Model }) {
  const device = model.device.value;
  const aside = model.putAside.value;
  if (aside !== undefined) {
    return (
      <Band tone="calm" dot="warn" title={TEXT.anotherSensor} data-key="another-sensor">
        <span class="grow">{TEXT.putAside(aside.of, model.fullName, aside.count)}</span>
        <Button look="small" words={TEXT.dismiss} onClick={() => (model.putAside.value = undefined)} />
      </Band>
    );
  }
  if (!device || device.unconfirmed_since === null) return null;
  return (
    <Band tone="calm" dot="warn" title={TEXT.notConfirmed} data-key="unconfirmed">
      <span class="grow">{TEXT.mayBeAnother(device.serial_number, clock(device.unconfirmed_since))}</span>
      <Button
        changes
        look="small edge"
        words={TEXT.readSettings}
        disabled={Boolean(model.jobs.value?.running)}
        onClick={() => readAll(model)}
      />
    </Band>
  );
}

/** Changes by another user in the settings edited here; the edits are applied on top. */
export function ElsewhereBand({ model }: { readonly model: Model }) {
  const found = model.elsewhere.value;
  const forms = model.forms.value;
  if (found.length === 0 || !forms) return null;
  return (
    <Band tone="calm" dot="warn" title={TEXT.changedElsewhere}>
      <div class="grow">
        <ul>
          {found.map((one) => (
            <li key={`${one.setting} ${one.path.join(".")}`}>
              {describe(forms, one, model.present.value[one.setting])}
              {one.conflict && <b class="edited-words"> {TEXT.editedHereToo}</b>}
            </li>
          ))}
        </ul>
        <span class="dim">{TEXT.editsRebased}</span>
      </div>
      <Button look="small" words={TEXT.dismiss} onClick={() => (model.elsewhere.value = [])} />
    </Band>
  );
}

/** A command began work that must be ended before anything else is done. */
export function UnfinishedBand({ model }: { readonly model: Model }) {
  const [words] = unfinishedOf(model);
  if (words === undefined) return null;
  return (
    <Band tone="calm" dot="off" title={TEXT.notFinished} data-key="unfinished">
      <span class="grow">{words}</span>
    </Band>
  );
}

export function ProblemLine({ model }: { readonly model: Model }) {
  const problem = model.problem.value;
  if (!problem || problem.kind === "view-only") return null;
  return (
    <Band dot="bad" title={<Message text={problem.message} />}>
      <span class="grow">
        <Message text={problem.hint} />
      </span>
      <Button look="small" words={TEXT.dismiss} onClick={() => (model.problem.value = undefined)} />
    </Band>
  );
}

/** @param now the setting as on the device */
function describe(
  forms: Forms,
  { setting, path, before, now: value }: RemoteChange,
  now: FormValues | undefined,
): string {
  const form = forms.settings.find(({ name }) => name === setting);
  if (form === undefined) return setting;
  const keyed = keyedList(form);
  if (keyed === undefined || path[0] !== keyed.list.name) {
    const field = fieldAt(form.fields, path);
    return `${whereOf(form, joined(path))}: ${said(field, before)} → ${said(field, value)}`;
  }
  const entry = (path.length > 2 ? at(now, path.slice(0, 2)) : (value ?? before)) as FormValues | undefined;
  const id = entry === undefined ? -1 : keyed.key(entry);
  const output = form.table?.rows.find((row) => (row.id & (form.table?.key_mask ?? -1)) === id);
  const title = `${form.title}, ${output?.title ?? id}`;
  if (path.length === 2) return `${title}: ${before === undefined ? FORMS.offToOn : FORMS.onToOff}`;
  const field = fieldAt(form.fields, path);
  return `${title}: ${said(field, before)} → ${said(field, value)}`;
}

function fieldAt(fields: readonly FieldForm[], path: readonly (string | number)[]): FieldForm | undefined {
  let found: FieldForm | undefined;
  for (const part of path) {
    if (typeof part === "number") continue;
    found = (found?.fields ?? fields).find(({ name }) => name === part);
  }
  return found;
}

const said = (field: FieldForm | undefined, value: unknown): string =>
  value === undefined
    ? NONE
    : field && typeof value !== "object"
      ? valueWords(field, value)
      : typeof value === "object"
        ? "…"
        : String(value);
