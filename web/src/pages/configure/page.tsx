/** The Configure page: settings on the left, the form in the middle, what extensions show on the right. Loaded when it is first opened. */
import { useEffect, useRef } from "preact/hooks";
import { BudgetLine } from "../../forms/budget-bar";
import { Button } from "../../ui/controls/button";
import type { App } from "../../page/context";
import { TopBar } from "../top-bar";
import { route } from "../../page/route";
import { Empty, LinkedBand, OfflineBand, ProblemBand, Starting } from "../empty-states";
import { ApplyBar } from "./apply-bar";
import { Command } from "./command-form";
import { Compare } from "./compare";
import { modelOf, type Model } from "./model";
import { ConfigureRail } from "./sidebar";
import { Discard, Setting } from "./setting-form";
import { KeepButton } from "./snapshot";
import { Restore } from "./restore";
import {
  ElsewhereBand,
  LostBand,
  NoForms,
  NotRead,
  ProblemLine,
  ReadingNote,
  SensorBand,
  UnreadSettings,
  UnfinishedBand,
  ViewOnlyBand,
} from "./empty-states";
import {
  configureOf,
  extensionPlace,
  linkTo,
  formPlaceOf,
  readAll,
  visibleSettings,
  CAUTIONS,
  type FormPlace,
  type Question,
} from "./view-state";
import { deviceInLink } from "../../wire/device-name";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/configure";
import { Slot } from "../../extension/extension";
import { StopJob } from "./jobs";
import type { CommandForm } from "../../wire/form-types";
import { Dialog } from "../../ui/controls/dialog";
import { Message } from "../../ui/controls/message";
import "./styles";

export function ConfigurePage({ app }: { readonly app: App }) {
  const device = app.device.value;
  const model = device ? modelOf(device.id, app) : undefined;
  const { question } = configureOf(app);
  const offline = app.store.connection.value !== "open" && app.state.value !== "starting";
  // biome-ignore lint/correctness/useExhaustiveDependencies: followAddress reads no more of the app than is listed
  useEffect(() => followAddress(app), [route.value.device, app.store.devices.value]);
  useEffect(() => {
    const onKey = (event: KeyboardEvent): void => {
      if (event.key.toLowerCase() !== "z" || !(event.ctrlKey || event.metaKey) || event.shiftKey || !model) return;
      if (
        event.target instanceof HTMLElement &&
        /^(INPUT|TEXTAREA)$/.test(event.target.tagName) &&
        (event.target as HTMLInputElement).type !== "checkbox"
      )
        return;
      event.preventDefault();
      model.undo();
    };
    addEventListener("keydown", onKey);
    return () => removeEventListener("keydown", onKey);
  }, [model]);
  return (
    <div class={`app configure ${offline ? "offline" : ""}`} data-state={app.state.value}>
      <a class="btn edge skip" href="#form">
        {TEXT.skipToTheForm}
      </a>
      <TopBar app={app} />
      {offline && <OfflineBand app={app} />}
      <ConfigureRail app={app} model={model} />
      <main class="settings-form flex-column" id="form" tabIndex={-1}>
        <ProblemBand app={app} />
        <LinkedBand app={app} />
        {model ? (
          <Centre model={model} app={app} />
        ) : app.state.value === "starting" ? (
          <Starting app={app} />
        ) : (
          <Empty app={app} />
        )}
      </main>
      <ConfigureSide key={model?.id} app={app} model={model} />
      {question.value && <Ask asked={question.value} close={() => (question.value = undefined)} />}
    </div>
  );
}

/** The device that the address names is the selected one, here and on the other pages. */
function followAddress(app: App): void {
  const { view } = app.viewState;
  const wanted = route.value.device;
  if (wanted === undefined) return;
  const found = deviceInLink(wanted, app.store.devices.value);
  app.linked.value = found === undefined ? wanted : undefined;
  if (found !== undefined && found.id !== view.peek().device) view.value = { ...view.peek(), device: found.id };
}

/** The form at the address, and what is said about the device. */
export function Centre({ model, app }: { readonly model: Model; readonly app: App }) {
  const forms = model.forms.value;
  if (!forms) return <NoForms model={model} />;
  const place = formPlaceOf(model, route.value.place);
  return (
    <>
      <Budget model={model} />
      <Title app={app} model={model} place={place} />
      <ViewOnlyBand />
      <SensorBand model={model} />
      <LostBand app={app} model={model} />
      <UnfinishedBand model={model} />
      <ElsewhereBand model={model} />
      <ProblemLine model={model} />
      <UnreadSettings model={model} />
      {forms.note && model.isRead.value && <p class="hint inset">{forms.note}</p>}
      <div class="places flex-column" key={`${model.id} ${place.kind} ${place.name}`}>
        <Shown model={model} app={app} place={place} />
      </div>
      <ApplyBar model={model} />
    </>
  );
}

/** What a search or a link names inside a form is brought into sight, and marked for a moment. */
function useSought(model: Model, place: FormPlace): void {
  const sought = route.value.more;
  const isForm = place.kind === "setting" || place.kind === "command";
  useEffect(() => {
    if (!isForm || sought === undefined) return;
    const key = CSS.escape(sought);
    const hex = CSS.escape(sought.replace(/[a-f]/g, (digit) => digit.toUpperCase()));
    const row = document.querySelector(
      `.places [data-field="${key}"], .places tr[data-id="${key}"], .places tr[data-id="${hex}"]`,
    );
    if (!(row instanceof HTMLElement)) return;
    row.scrollIntoView({ block: "center" });
    row.classList.add("sought");
    const timer = setTimeout(() => row.classList.remove("sought"), 2500);
    return () => clearTimeout(timer);
  }, [place.name, sought, isForm, model.isRead.value, model.page.all.value]);
}

function Shown({ model, app, place }: { readonly model: Model; readonly app: App; readonly place: FormPlace }) {
  const command = model.command(place.name);
  const setting = model.setting(place.name);
  useSought(model, place);
  switch (place.kind) {
    case "compare":
      return <Compare model={model} store={app.store} />;
    case "extension": {
      const View = extensionPlace(place.name)?.View;
      return View ? <View model={model} /> : null;
    }
    case "restore":
      return (
        <section class="setting" aria-label={TEXT.restoreCommunication}>
          <div class="setting-words">
            <p>{TEXT.restoreIntro}</p>
          </div>
          <Restore model={model} />
        </section>
      );
    case "command":
      if (command && command.writes !== "" && !model.isRead.value) return <Unread model={model} />; // it opens with what the device has
      return command ? <Command model={model} form={command} /> : null;
    case "nothing":
      return <p class="hint inset">{TEXT.settingNotFound(place.name)}</p>;
    case "setting":
    case "group": {
      const settings = setting
        ? 1
        : (model.forms.value?.settings.filter(({ group }) => group === place.name).length ?? 0);
      if (settings > 0 && !model.isRead.value) return <Unread model={model} />;
      return setting ? (
        <Setting model={model} form={setting} alone />
      ) : (
        <SettingGroup model={model} name={place.name} />
      );
    }
  }
}

/** In the place of a form that shows what the device has, until that is known. */
function Unread({ model }: { readonly model: Model }) {
  return model.jobs.value?.running ? <ReadingNote model={model} /> : <NotRead model={model} />;
}

/** The load of all outputs in one line: on a phone it stays in sight. */
function Budget({ model }: { readonly model: Model }) {
  const form = model.forms.value?.settings.find(({ table }) => table !== null);
  if (!form) return null;
  return <BudgetLine load={model.loadOf(form.name) ?? model.loadOf(`=${form.name}`)} baud={model.baud.value} />;
}

function Title({ app, model, place }: { readonly app: App; readonly model: Model; readonly place: FormPlace }) {
  const { sheet } = app;
  const { all } = model.page;
  const visible = place.kind === "group" ? visibleSettings(model, place.name) : [];
  const form = model.setting(place.name) ?? (visible.length === 1 ? visible[0] : undefined);
  const command = model.command(place.name);
  const title =
    {
      compare: TEXT.compare,
      extension: extensionPlace(place.name)?.title,
      restore: TEXT.restoreCommunication,
      group: place.name,
      nothing: TEXT.notFound,
      setting: form?.title,
      command: command?.title,
    }[place.kind] ?? "";
  const group = (form ?? command)?.group;
  const isForm = place.kind === "setting" || place.kind === "command" || place.kind === "group";
  useEffect(() => {
    document.title = [title, model.fullName, "imuscope"].filter(Boolean).join(" · ");
  }, [title, model.fullName]);
  return (
    <div class="title">
      <div class="names">
        <h1>{title}</h1>
        <p class="ellipsis">
          {group !== undefined && group !== title && (
            <span class="desk">
              <a href={linkTo(model, group)}>{group}</a> ·{" "}
            </span>
          )}
          <span>{model.fullName}</span>
          {(form || command) && (
            <span>
              {" · "}
              <span class="mono">{(form ?? command)?.name}</span>
            </span>
          )}
          {(form ?? command)?.source && <span class="desk">, {(form ?? command)?.source}</span>}
        </p>
      </div>
      <span class="grow" />
      <Button
        look="edge phone"
        icon="search"
        words={COMMON.settings}
        aria-expanded={sheet.value === "rail"}
        aria-controls="rail"
        onClick={() => (sheet.value = "rail")}
      />
      {form && (
        <span class="desk">
          <Discard model={model} form={form} edits={model.counts.value.get(form.name) ?? 0} />
        </span>
      )}
      {place.kind === "compare" && <KeepButton model={model} />}
      {isForm && model.isRead.value && <ReadAgain model={model} />}
      {isForm && (
        <div class="segmented" role="group" aria-label={TEXT.detailLevel}>
          <button type="button" aria-pressed={!all.value} onClick={() => (all.value = false)}>
            {TEXT.basic}
          </button>
          <button type="button" aria-pressed={all.value} onClick={() => (all.value = true)}>
            {COMMON.all}
          </button>
        </div>
      )}
    </div>
  );
}

function ReadAgain({ model }: { readonly model: Model }) {
  return (
    <Button
      changes
      words={TEXT.readAgain}
      disabled={Boolean(model.jobs.value?.running)}
      title={TEXT.readAllHint}
      onClick={() => readAll(model)}
    />
  );
}

declare module "../../extension/extension" {
  interface Slots {
    /** On the right of Configure; without a model there is no device. */
    readonly configureSide: { readonly app: App; readonly model: Model | undefined };
  }
}

function ConfigureSide({ app, model }: { readonly app: App; readonly model: Model | undefined }) {
  return (
    <aside class={`side ${app.sheet.value === "side" ? "open" : ""}`} id="side" aria-label={COMMON.trafficLog}>
      <Slot name="configureSide" with={{ app, model }} />
      {model && <Queue model={model} />}
    </aside>
  );
}

/** Running and waiting jobs. */
function Queue({ model }: { readonly model: Model }) {
  const jobs = model.jobs.value;
  const waiting = jobs?.queue ?? [];
  const running = jobs?.running;
  return (
    <div class="queue dim text-xs">
      {running && (
        <p>
          <span class="dot live" />
          <span class="grow ellipsis">
            {running.title}
            {running.step ? `: ${running.step}` : ""}
          </span>
          <StopJob model={model} job={running} />
        </p>
      )}
      {waiting.map((job) => (
        <p key={job.id}>
          <span class="dot off" />
          <span class="grow ellipsis">{job.title}</span>
          <StopJob model={model} job={job} />
        </p>
      ))}
      {!running && waiting.length === 0 && (
        <p>
          <span class="dot off" />
          {TEXT.queueEmpty}
        </p>
      )}
    </div>
  );
}

function SettingGroup({ model, name }: { readonly model: Model; readonly name: string }) {
  const forms = model.forms.value;
  if (!forms) return null;
  const onlySends = forms.settings.length === 0;
  const settings = forms.settings.filter((form) => form.group === name);
  const commands = forms.commands.filter((form) => form.group === name);
  const visible = visibleSettings(model, name);
  // commands behind a setting's form are not listed again
  const others = commands.filter(
    (form) => model.page.all.value || settings.length === 0 || (form.kind === "do" && form.basic),
  );
  return (
    <>
      {visible.map((form) => (
        <Setting key={form.name} model={model} form={form} alone={visible.length === 1} />
      ))}
      {others.length > 0 && (
        <section class="setting" aria-label={TEXT.commands}>
          {settings.length > 0 && (
            <div class="setting-head">
              <h2>{TEXT.commands}</h2>
            </div>
          )}
          {onlySends && (
            <p class="hint inset" role="note">
              <b>{TEXT.noSettings(model.device.value?.name ?? COMMON.theDevice)}</b> {TEXT.framesToSend}
            </p>
          )}
          <ul class="commands">
            {others.map((form) => (
              <Row key={form.name} model={model} form={form} kind={onlySends ? TEXT.toTheDevice : KINDS[form.kind]} />
            ))}
          </ul>
        </section>
      )}
    </>
  );
}

const KINDS: Readonly<Record<CommandForm["kind"], string>> = { ask: TEXT.read, set: TEXT.write, do: TEXT.action };

interface RowProps {
  readonly model: Model;
  readonly form: CommandForm;
  readonly kind: string;
}

function Row({ model, form, kind }: RowProps) {
  return (
    <li>
      <a href={linkTo(model, form.name)}>
        <b>{form.title}</b>
        <span class="dim mono ellipsis">{form.name}</span>
        <span class="grow" />
        {form.caution ? <span class="tag">▲ {CAUTIONS[form.caution]}</span> : <span class="dim">{kind}</span>}
        {form.doc !== "" && <span class="field-help dim text-xs">{form.doc}</span>}
      </a>
    </li>
  );
}

/** Confirmation before harm: a dialog that names what is lost or cut; the safe button has the focus. */
export function Ask({ asked, close }: { readonly asked: Question; readonly close: () => void }) {
  const safe = useRef<HTMLButtonElement>(null);
  useEffect(() => safe.current?.focus(), []);
  const act = (): void => {
    close();
    asked.act();
  };
  return (
    <Dialog title={asked.title} onClose={close}>
      {asked.about !== "" && <p class="question-about">{asked.about}</p>}
      {asked.caution !== "" && (
        <p class="question-subject">
          <span class="tag warn">▲ {CAUTIONS[asked.caution]}</span>
        </p>
      )}
      {asked.words.map((words) => (
        <p key={words} class="question-words">
          <Message text={words} />
        </p>
      ))}
      <div class="question-actions flex-wrap">
        <Button look="main" words={TEXT.leaveUnchanged} ref={safe} onClick={close} />
        <Button look="edge" words={asked.go} onClick={act} />
      </div>
    </Dialog>
  );
}
