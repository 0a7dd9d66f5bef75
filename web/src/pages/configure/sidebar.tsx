/** The left side: device, search, groups with their edits, and restorable states. */
import { fromExtensions } from "../../extension/extension";
import { search } from "../../forms/search";
import { dayWords } from "../../recordings/library-filter";
import type { SnapshotInfo } from "../../wire/form-types";
import { OptionList } from "../../ui/controls/choices";
import { clock } from "../../ui/format/format";
import { IconButton } from "../../ui/controls/icon-button";
import { Icon } from "../../ui/controls/icons";
import { SearchField } from "../../ui/controls/search-field";
import { markOf } from "../../page/page-state";
import { select } from "../../page/app-state";
import type { App } from "../../page/context";
import { go, route } from "../../page/route";
import type { Model } from "./model";
import { listed, snapshotTitle } from "./sides";
import { linkTo, formPlaceOf } from "./view-state";
import { linkName, listName } from "../../wire/device-name";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/configure";

/** Snapshots of writes in the sidebar, beside named ones; Compare has all. */
const MAX_LISTED = 5;

export function ConfigureRail({ app, model }: { readonly app: App; readonly model: Model | undefined }) {
  const { sheet } = app;
  const close = (): void => {
    sheet.value = undefined;
  };
  return (
    <aside class={`rail ${sheet.value === "rail" ? "open" : ""}`} id="rail" aria-label={COMMON.settings}>
      <div class="head">
        <h2>{COMMON.device}</h2>
        <span class="grow" />
        {sheet.value === "rail" && <IconButton icon="close" label={TEXT.closeSettingsList} onClick={close} />}
      </div>
      <DevicePicker app={app} />
      {model?.forms.value && (
        <>
          <SettingSearch model={model} sheet={sheet} />
          {model.page.query.value.trim() ? (
            <Results model={model} close={close} />
          ) : (
            <Groups model={model} close={close} />
          )}
          <GoBack model={model} close={close} />
        </>
      )}
      <div class="foot dim text-xs">{TEXT.snapshotNote}</div>
    </aside>
  );
}

function DevicePicker({ app }: { readonly app: App }) {
  const device = app.device.value;
  const mark = device ? markOf(device.status, 0) : { dot: "off", word: "none" };
  const choose = (id: string): void => {
    select(app, id);
    go("configure", linkName(id, app.store.devices.peek()));
  };
  return (
    <div class="rail-padding">
      <label class="select device-select">
        <span class={`dot ${mark.dot}`} />
        <span class="visually-hidden">{TEXT.deviceState(mark.word)}</span>
        <OptionList
          value={app.viewState.device.value ?? ""}
          options={app.store.devices.value.map((device) => [device.id, listName(device)])}
          onChoose={choose}
        />
        <Icon name="down" />
      </label>
    </div>
  );
}

function SettingSearch({ model, sheet }: { readonly model: Model; readonly sheet: App["sheet"] }) {
  const { query } = model.page;
  const forms = model.forms.value;
  const count = (forms?.settings.length ?? 0) + (forms?.commands.length ?? 0);
  const unfold = (): void => {
    if (matchMedia("(max-width: 1119px)").matches) sheet.value = "rail";
  };
  const onKey = (event: KeyboardEvent): void => {
    const [first] = search(model.index.value, query.value);
    if (event.key === "Enter" && first) {
      location.hash = linkTo(model, first.name, first.at || undefined);
      sheet.value = undefined;
    }
    if (event.key !== "Escape") return;
    query.value = "";
    if (document.activeElement instanceof HTMLElement) document.activeElement.blur();
  };
  return (
    <div class="rail-padding">
      <SearchField
        label={TEXT.searchSettingsAndCommands}
        placeholder={TEXT.searchSettings(count)}
        value={query.value}
        onText={(text) => (query.value = text)}
        onKeyDown={onKey}
        hasKey
        unfold={unfold}
      />
    </div>
  );
}

interface Props {
  readonly model: Model;
  /** Closes the sidebar if it lies over the page. */
  readonly close: () => void;
}

function Results({ model, close }: Props) {
  const found = search(model.index.value, model.page.query.value);
  if (found.length === 0) return <p class="rail-padding dim">{TEXT.noMatch}</p>;
  return (
    <nav class="categories found" aria-label={TEXT.matches}>
      {found.map(({ kind, name, title, group, field, at }) => (
        <a
          key={`${kind} ${name}`}
          href={linkTo(model, name, at || undefined)}
          onClick={close}
          {...(route.value.place === name ? { "aria-current": "true" as const } : {})}
        >
          <span class="ellipsis">
            {title}
            <small class="dim ellipsis">{field ? `${field} · ${name}` : `${group} · ${name}`}</small>
          </span>
          {kind === "command" && <span class="count">{TEXT.command}</span>}
        </a>
      ))}
    </nav>
  );
}

function Groups({ model, close }: Props) {
  const forms = model.forms.value;
  if (!forms) return null;
  const place = formPlaceOf(model, route.value.place);
  const current =
    place.kind === "group" ? place.name : (model.setting(place.name)?.group ?? model.command(place.name)?.group);
  return (
    <nav class="categories" aria-label={TEXT.settingGroups}>
      {forms.groups.map((group) => {
        const settings = forms.settings.filter((form) => form.group === group);
        const edits = settings.reduce((sum, form) => sum + (model.counts.value.get(form.name) ?? 0), 0);
        const total = settings.length + forms.commands.filter((form) => form.group === group).length;
        return (
          <a
            key={group}
            href={linkTo(model, group)}
            onClick={close}
            {...(group === current ? { "aria-current": "true" as const } : {})}
          >
            <span class="ellipsis">{group}</span>
            {edits > 0 ? (
              <span class="tag yours" title={TEXT.changedCount(edits)}>
                {edits}
                <span class="visually-hidden"> {TEXT.changed}</span>
              </span>
            ) : (
              <span class="count">{total}</span>
            )}
          </a>
        );
      })}
      {fromExtensions("configurePlaces")
        .filter((one) => one.applies(forms))
        .map(({ name, title, note }) => (
          <a
            key={name}
            href={linkTo(model, name)}
            onClick={close}
            {...(place.kind === "extension" && place.name === name ? { "aria-current": "true" as const } : {})}
          >
            <span class="ellipsis">{title}</span>
            <span class="count">{note}</span>
          </a>
        ))}
      {forms.settings.length > 0 && (
        <a
          href={linkTo(model, "restore")}
          onClick={close}
          {...(place.kind === "restore" ? { "aria-current": "true" as const } : {})}
        >
          <span class="ellipsis">{TEXT.restoreCommunication}</span>
        </a>
      )}
    </nav>
  );
}

function GoBack({ model, close }: Props) {
  if ((model.forms.value?.settings.length ?? 0) === 0) return null;
  const { place, more } = route.value;
  const current = (name: string) => (place === "compare" && more === name ? { "aria-current": "true" as const } : {});
  return (
    <>
      <div class="head go-back">
        <h3>{TEXT.snapshots}</h3>
        <span class="grow" />
        <a class="btn" href={linkTo(model, "compare")} onClick={close}>
          {TEXT.compare}
        </a>
      </div>
      <nav class="categories" aria-label={TEXT.snapshots}>
        {listed(model.snapshots.value, MAX_LISTED).map((snapshot) => (
          <a
            key={snapshot.name}
            href={linkTo(model, "compare", snapshot.name)}
            onClick={close}
            title={[snapshotTitle(snapshot), snapshot.reason].join("\n")}
            {...current(snapshot.name)}
          >
            <span class="name">{snapshotTitle(snapshot)}</span>
            <span class="count">{when(snapshot)}</span>
          </a>
        ))}
        {model.forms.value?.factory && (
          <a href={linkTo(model, "compare", "~factory")} onClick={close} {...current("~factory")}>
            {TEXT.factoryDefault}
          </a>
        )}
      </nav>
    </>
  );
}

const DAY_S = 86_400;

/** "14:31:05" today, "18 Nov" before. UTC, as every time on the page. */
export function when({ taken }: Pick<SnapshotInfo, "taken">): string {
  if (Date.now() / 1000 - taken < DAY_S) return clock(taken).slice(0, 8);
  return dayWords(taken);
}
