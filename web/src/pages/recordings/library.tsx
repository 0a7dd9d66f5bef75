/** The library: every recording in the folder, newest first, with what is known of it without opening it. */
import { useEffect, useRef } from "preact/hooks";
import { bytes, CATEGORIES, dateWords, deviceName, flaw, inCategory, length, tally, titleOf } from "../../recordings/library-filter";
import type { RecordingInfo } from "../../recordings/types";
import { count } from "../../ui/format";
import { Icon } from "../../ui/icons";
import { Message } from "../../ui/message";
import { type App, sheet } from "../app-state";
import { Bar } from "../top-bar";
import { href } from "../route";
import { OfflineBand, ProblemBand } from "../empty-states";
import { PageOverlays } from "./overlays";
import { Details } from "./details";
import { aboutToOpen, add, all, choice, choose, coming, current, dismiss, follow, gone, selected, shown, trouble, undelete } from "./library-store";
import { Thumb } from "./thumbnail";

export function LibraryPage({ app }: { readonly app: App }) {
  useEffect(() => follow(app), []);
  useEffect(() => {
    document.title = "Recordings · imuscope";
  }, []);
  const offline = app.store.connection.value === "closed" || app.store.silentSince.value !== undefined;
  return (
    <div class={`app lib ${offline ? "offline" : ""}`}>
      <a class="btn edge skip" href="#list">
        Skip to the list
      </a>
      <Bar app={app} />
      {offline && <OfflineBand app={app} />}
      <Filters />
      <main class="libmid" id="list" tabIndex={-1}>
        <h1 class="vh">Recordings</h1>
        <ProblemBand />
        <Tools />
        <Arrivals />
        <Gone />
        <List app={app} />
      </main>
      <aside class={`side ${sheet.value === "side" ? "open" : ""}`} id="side" aria-label="This recording">
        {current.value ? <Details key={current.value.id} info={current.value} app={app} /> : <p class="foot-note dim pad">Choose a recording to see what is in it.</p>}
      </aside>
      <PageOverlays app={app} />
    </div>
  );
}

function Filters() {
  const list = all.value ?? [];
  const kept = list.filter(({ deleted }) => deleted === null);
  const { category, device, tag } = choice.value;
  const devices = tally(kept.flatMap((info) => [...new Set(info.devices.map(deviceName))]));
  const tags = tally(kept.flatMap((info) => info.tags));
  return (
    <aside class={`rail ${sheet.value === "rail" ? "open" : ""}`} id="rail" aria-label="Filters">
      <div class="head">
        <h2>Library</h2>
        <span class="grow" />
        {sheet.value === "rail" && (
          <button type="button" class="btn icon" aria-label="Close the filters" onClick={() => (sheet.value = undefined)}>
            <Icon name="close" />
          </button>
        )}
      </div>
      <div class="cats" role="group" aria-label="Which recordings">
        {CATEGORIES.map(({ name, title }) => (
          <Filter key={name} title={title} n={list.filter((info) => inCategory(info, name)).length} on={category === name} set={() => choose({ category: name })} />
        ))}
      </div>
      {devices.length > 0 && (
        <>
          <div class="head also">
            <h3>Device</h3>
          </div>
          <div class="cats" role="group" aria-label="Device">
            {devices.map(([name, n]) => (
              <Filter key={name} title={name} n={n} on={device === name} set={() => choose({ device: device === name ? "" : name })} />
            ))}
          </div>
        </>
      )}
      {tags.length > 0 && (
        <>
          <div class="head also">
            <h3>Tag</h3>
          </div>
          <div class="tagcloud" role="group" aria-label="Tag">
            {tags.map(([name, n]) => (
              <button type="button" key={name} class="tag line" aria-pressed={tag === name} onClick={() => choose({ tag: tag === name ? "" : name })}>
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
      <span class="ell">{title}</span>
      <span class="c">{n}</span>
    </button>
  );
}

function Tools() {
  const field = useRef<HTMLInputElement>(null);
  const files = useRef<HTMLInputElement>(null);
  useEffect(() => {
    const onKey = (event: KeyboardEvent): void => {
      const typing = event.target instanceof HTMLElement && /^(INPUT|TEXTAREA|SELECT)$/.test(event.target.tagName);
      if (event.key !== "/" || typing || event.ctrlKey || event.metaKey) return;
      event.preventDefault();
      field.current?.focus();
    };
    addEventListener("keydown", onKey);
    return () => removeEventListener("keydown", onKey);
  }, []);
  const list = shown.value;
  const seconds = list.reduce((sum, { duration }) => sum + (duration ?? 0), 0);
  const take = (): void => {
    void add([...(files.current?.files ?? [])]);
    if (files.current) files.current.value = "";
  };
  return (
    <div class="tools">
      <label class="field">
        <span class="vh">Search</span>
        <Icon name="search" />
        <input ref={field} type="search" placeholder="Name, note, tag, device, date" value={choice.value.query} onInput={(event) => choose({ query: event.currentTarget.value })} />
        <kbd class="desk">/</kbd>
      </label>
      <button type="button" class="btn edge icon phone" aria-label="Filters" onClick={() => (sheet.value = "rail")}>
        <Icon name="list" />
      </button>
      <span class="grow desk" />
      <span class="dim desk sum">
        {count(list.length, "recording")}
        {seconds > 0 && ` · ${length(seconds)}`} · newest first
      </span>
      <input ref={files} type="file" multiple hidden onChange={take} aria-label="Files to add" />
      <button type="button" class="btn edge" aria-label="Add files" title="Add recordings, logs and captures of any kind; or drop them here" onClick={() => files.current?.click()}>
        <Icon name="upload" />
        <span class="desk">Add files</span>
      </button>
    </div>
  );
}

function Arrivals() {
  if (coming.value.length === 0) return null;
  return (
    <ul class="coming" aria-label="Files being added">
      {coming.value.map(({ key, name, share, problem, cancel }) => (
        <li key={key}>
          <b class="ell">{name}</b>
          {problem ? (
            <span class="why" role="alert">
              <span class="dot bad" /> <Message text={problem.message} /> <Message text={problem.hint} />
            </span>
          ) : (
            <progress value={share} max={1} aria-label={`${name}: ${Math.round(100 * share)} %`} />
          )}
          <button type="button" class="btn icon" aria-label={problem ? `Forget ${name}` : `Do not add ${name}`} onClick={() => (problem ? dismiss(key) : cancel())}>
            <Icon name="close" />
          </button>
        </li>
      ))}
    </ul>
  );
}

function Gone() {
  const deleted = gone.value;
  if (!deleted) return null;
  return (
    <div class="band calm" role="status">
      <b class="ell">{titleOf(deleted)} is deleted</b>
      <span class="mid">It is kept for 7 days.</span>
      <span class="grow" />
      <button type="button" class="btn edge" onClick={() => void undelete(deleted.id)}>
        <Icon name="undo" />
        Undo
      </button>
      <button type="button" class="btn icon" aria-label="Close" onClick={() => (gone.value = undefined)}>
        <Icon name="close" />
      </button>
    </div>
  );
}

function List({ app }: { readonly app: App }) {
  if (trouble.value && all.value === undefined) return <Nothing title="The list could not be loaded" words={`${trouble.value.message} ${trouble.value.hint}`} />;
  if (all.value === undefined) return <div class="recs" aria-busy="true" />;
  if (all.value.length === 0) {
    return <Nothing title="No recording yet" words="Press Record in the bar, or Shift R, and everything that arrives is kept. Logs and captures made elsewhere can be dropped here." />;
  }
  if (shown.value.length === 0) return <Nothing title="Nothing is found" words="No recording has all of that. Take a filter or a word away." />;
  return (
    <div class="recs" tabIndex={0} role="region" aria-label="Recordings">
      <table>
        <caption class="vh">Recordings, newest first</caption>
        <colgroup>
          {["motion", "name", "devices", "length", "size", "loss", "tags"].map((name) => (
            <col key={name} class={name} />
          ))}
        </colgroup>
        <thead>
          <tr>
            <th scope="col">Motion</th>
            <th scope="col">Recording</th>
            <th scope="col">Devices</th>
            <th scope="col" class="num">
              Length
            </th>
            <th scope="col" class="num">
              Size
            </th>
            <th scope="col">Loss</th>
            <th scope="col">Tags</th>
          </tr>
        </thead>
        <tbody>
          {shown.value.map((info) => (
            <Row key={info.id} info={info} app={app} />
          ))}
        </tbody>
      </table>
    </div>
  );
}

function Nothing({ title, words }: { readonly title: string; readonly words: string }) {
  return (
    <div class="veil">
      <section class="card">
        <h2>{title}</h2>
        <p><Message text={words} /></p>
      </section>
    </div>
  );
}

function Row({ info, app }: { readonly info: RecordingInfo; readonly app: App }) {
  const { tone, words } = flaw(info);
  const size = bytes(info.recording ? (app.store.recorder.value?.bytes ?? info.size) : info.size);
  const pick = (): void => {
    selected.value = info.id;
  };
  const devices = info.devices.map(({ name, product }) => name || product).join(" + ");
  const about = info.damaged || info.notes || info.file;
  const open = !info.recording && info.deleted === null;
  return (
    <tr class={selected.value === info.id ? "on" : ""} onClick={pick}>
      <td>
        <Thumb info={info} />
      </td>
      <td>
        <b class="ell">
          {open ? <a href={href("recordings", info.id)} {...aboutToOpen(info)}>{titleOf(info)}</a> : titleOf(info)}
          {info.pinned && <Icon name="pin" />}
        </b>
        <small class="ell">
          {info.recording && (
            <span class="tag recnow">
              <i class="recdot" /> recording now
            </span>
          )}
          {tone !== "" && <span class={`tag ${tone} phone`}>{words}</span>}
          {about}
        </small>
      </td>
      <td class="mid devs" title={devices}>
        <span>{devices}</span>
      </td>
      <td class="num">
        {length(info.duration)}
        <small>{dateWords(info.started)}</small>
      </td>
      <td class="num">
        {size.value}
        <span class="u">{size.unit}</span>
      </td>
      <td>{tone === "" ? <span class="dim">{words}</span> : <span class={`tag ${tone}`}>{words}</span>}</td>
      <td>
        <span class="tags">
          {info.tags.map((tag) => (
            <span class="tag line" key={tag}>
              {tag}
            </span>
          ))}
        </span>
        <button
          type="button"
          class="btn icon phone more"
          aria-label={`Details of ${titleOf(info)}`}
          onClick={() => {
            pick();
            sheet.value = "side";
          }}
        >
          <Icon name="dots" />
        </button>
      </td>
    </tr>
  );
}
