/** The left side: which device, search, groups with their edits, and the states that one can go back to. */
import { useLayoutEffect, useRef } from "preact/hooks";
import { view } from "../../data/view-state";
import { search } from "../../forms/search";
import type { SnapshotInfo } from "../../forms/types";
import { clock } from "../../ui/format";
import { Icon } from "../../ui/icons";
import { markOf } from "../../ui/page-state";
import { type App, select, sheet } from "../app-state";
import { go } from "../route";
import type { Model } from "./model";
import { listed, titleOf } from "./sides";
import { here, linkTo, placeOf, query } from "./view-state";

/** Snapshots of writes that the rail lists, beside those with a name; the page Compare has all. */
const LISTED = 5;

export function ConfigureRail({ app, model }: { readonly app: App; readonly model: Model | undefined }) {
  return (
    <aside class={`rail ${sheet.value === "rail" ? "open" : ""}`} id="rail" aria-label="Settings">
      <div class="head">
        <h2>Device</h2>
        <span class="grow" />
        {sheet.value === "rail" && (
          <button type="button" class="btn icon" aria-label="Close the list of settings" onClick={() => (sheet.value = undefined)}>
            <Icon name="close" />
          </button>
        )}
      </div>
      <DevicePicker app={app} />
      {model?.forms.value && (
        <>
          <SearchField model={model} />
          {query.value.trim() ? <Results model={model} /> : <Groups model={model} />}
          <GoBack model={model} />
        </>
      )}
      <div class="foot">A snapshot is kept before every write, by serial number.</div>
    </aside>
  );
}

function DevicePicker({ app }: { readonly app: App }) {
  const device = app.device.value;
  const mark = device ? markOf(device.status, 0) : { dot: "off", word: "none" };
  const choose = (id: string): void => {
    select(id);
    go("configure", id);
  };
  return (
    <div class="railpad">
      <label class="select devpick">
        <span class={`dot ${mark.dot}`} />
        <span class="vh">Device, {mark.word}</span>
        <select value={view.value.device ?? ""} onChange={(event) => choose(event.currentTarget.value)}>
          {app.store.devices.value.map(({ id, name, serial_number }) => (
            <option key={id} value={id}>
              {name}
              {serial_number ? ` · ${serial_number}` : ""}
            </option>
          ))}
        </select>
        <Icon name="down" />
      </label>
    </div>
  );
}

function SearchField({ model }: { readonly model: Model }) {
  const field = useRef<HTMLInputElement>(null);
  const forms = model.forms.value;
  const count = (forms?.settings.length ?? 0) + (forms?.commands.length ?? 0);
  useLayoutEffect(() => {
    const onKey = (event: KeyboardEvent): void => {
      const target = event.target instanceof HTMLElement ? event.target : document.body;
      if (event.key !== "/" || event.ctrlKey || event.metaKey || event.altKey || /^(INPUT|TEXTAREA|SELECT)$/.test(target.tagName)) return;
      event.preventDefault();
      sheet.value = matchMedia("(max-width: 1119px)").matches ? "rail" : sheet.value;
      requestAnimationFrame(() => field.current?.focus());
    };
    addEventListener("keydown", onKey);
    return () => removeEventListener("keydown", onKey);
  }, []);
  const onKey = (event: KeyboardEvent): void => {
    const [first] = search(model.index.value, query.value);
    if (event.key === "Enter" && first) {
      location.hash = linkTo(model, first.name, first.at || undefined);
      sheet.value = undefined;
    }
    if (event.key !== "Escape") return;
    query.value = "";
    field.current?.blur();
  };
  return (
    <div class="railpad">
      <label class="field searchfield">
        <Icon name="search" />
        <span class="vh">Search settings and commands</span>
        <input
          ref={field}
          type="search"
          placeholder={`Search ${count} settings`}
          value={query.value}
          autocomplete="off"
          spellcheck={false}
          onInput={(event) => (query.value = event.currentTarget.value)}
          onKeyDown={onKey}
        />
        <kbd class="desk">/</kbd>
      </label>
    </div>
  );
}

const close = (): void => {
  sheet.value = undefined;
};

function Results({ model }: { readonly model: Model }) {
  const found = search(model.index.value, query.value);
  if (found.length === 0) return <p class="railpad dim">Nothing is called that.</p>;
  return (
    <nav class="cats found" aria-label="Found">
      {found.map(({ kind, name, title, group, field, at }) => (
        <a key={`${kind} ${name}`} href={linkTo(model, name, at || undefined)} onClick={close} {...(here.value.place === name ? { "aria-current": "true" as const } : {})}>
          <span class="ell">
            {title}
            <small class="dim ell">{field ? `${field} · ${name}` : `${group} · ${name}`}</small>
          </span>
          {kind === "command" && <span class="c">command</span>}
        </a>
      ))}
    </nav>
  );
}

function Groups({ model }: { readonly model: Model }) {
  const forms = model.forms.value;
  if (!forms) return null;
  const place = placeOf(model, here.value.place);
  const current = place.kind === "group" ? place.name : (model.setting(place.name)?.group ?? model.command(place.name)?.group);
  return (
    <nav class="cats" aria-label="Groups of settings">
      {forms.groups.map((group) => {
        const settings = forms.settings.filter((form) => form.group === group);
        const edits = settings.reduce((sum, form) => sum + (model.counts.value.get(form.name) ?? 0), 0);
        const total = settings.length + forms.commands.filter((form) => form.group === group).length;
        return (
          <a key={group} href={linkTo(model, group)} onClick={close} {...(group === current ? { "aria-current": "true" as const } : {})}>
            <span class="ell">{group}</span>
            {edits > 0 ? (
              <span class="tag yours" title={`${edits} changed`}>
                {edits}
                <span class="vh"> changed</span>
              </span>
            ) : (
              <span class="c">{total}</span>
            )}
          </a>
        );
      })}
      {forms.corrections && (
        <a href={linkTo(model, "corrections")} onClick={close} {...(place.kind === "corrections" ? { "aria-current": "true" as const } : {})}>
          <span class="ell">Corrections</span>
          <span class="c">RTCM</span>
        </a>
      )}
      {forms.settings.length > 0 && (
        <a href={linkTo(model, "restore")} onClick={close} {...(place.kind === "restore" ? { "aria-current": "true" as const } : {})}>
          <span class="ell">Restore communication</span>
        </a>
      )}
    </nav>
  );
}

function GoBack({ model }: { readonly model: Model }) {
  if ((model.forms.value?.settings.length ?? 0) === 0) return null;
  const { place, more } = here.value;
  const current = (name: string) => (place === "compare" && more === name ? { "aria-current": "true" as const } : {});
  return (
    <>
      <div class="head goback">
        <h3>Snapshots</h3>
        <span class="grow" />
        <a class="btn" href={linkTo(model, "compare")} onClick={close}>
          Compare
        </a>
      </div>
      <nav class="cats" aria-label="Snapshots">
        {listed(model.snapshots.value, LISTED).map((snapshot) => (
          <a key={snapshot.name} href={linkTo(model, "compare", snapshot.name)} onClick={close} title={[titleOf(snapshot), snapshot.reason].join("\n")} {...current(snapshot.name)}>
            <span class="ell">{titleOf(snapshot)}</span>
            <span class="c">{when(snapshot)}</span>
          </a>
        ))}
        {model.forms.value?.factory && (
          <a href={linkTo(model, "compare", "~factory")} onClick={close} {...current("~factory")}>
            Factory default
          </a>
        )}
      </nav>
    </>
  );
}

const DAY = 86_400;

/** "14:31:05" today, "18 Nov" before. UTC, as every time on the page. */
export function when({ taken }: Pick<SnapshotInfo, "taken">): string {
  if (Date.now() / 1000 - taken < DAY) return clock(taken).slice(0, 8);
  return new Date(taken * 1000).toLocaleDateString("en-GB", { day: "numeric", month: "short", timeZone: "UTC" });
}
