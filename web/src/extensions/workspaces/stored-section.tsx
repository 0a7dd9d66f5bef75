/** Stored workspaces in the sheet: chosen, saved, exported, imported, deleted, and set for a family. */
import { type Signal, useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { Slot, type Slots } from "../../extension/extension";
import { selected } from "../../panels/panel-context";
import { Button } from "../../ui/controls/button";
import { Select } from "../../ui/controls/choices";
import type { HttpProblem } from "../../requests/http";
import { ProblemNote } from "../../requests/problem-note";
import { protocolOf, isViewOnly } from "../../wire/capabilities";
import type { WorkspaceList } from "../../wire/routes";

import {
  currentOf,
  exportFile,
  importFile,
  listWorkspaces,
  openStored,
  removeStored,
  saveAs,
  setDefault,
} from "./stored";
import "./workspaces.css";
import { TEXT } from "./texts";

type Props = Slots["workspaceSheet"];

export function StoredSection({ session, deps }: Props) {
  const list = useSignal<WorkspaceList>({ workspaces: [], defaults: {} });
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const said = useSignal("");
  const refresh = async (): Promise<void> => {
    const outcome = await listWorkspaces();
    if (outcome.ok) list.value = outcome.value;
    else problem.value = outcome.problem;
  };
  // biome-ignore lint/correctness/useExhaustiveDependencies: read when the sheet is opened
  useEffect(() => void refresh(), []);
  /** Carry out a change; its problem, or the words of its success, stay on screen. */
  const turn = useRef(0);
  const run = async (act: () => Promise<HttpProblem | undefined>, done: string): Promise<void> => {
    const mine = ++turn.current;
    const found = await act();
    if (mine !== turn.current) return; // another choice has been made since
    problem.value = found;
    said.value = found ? "" : done;
    await refresh();
  };
  const { problems } = session;
  const current = currentOf(session);
  const name = current.value?.name;
  const choose = (next: string): void => {
    said.value = "";
    if (next !== "") void run(() => openStored(session, next), TEXT.opened(next));
  };
  return (
    <div class="stored">
      <div class="stored-row control-row">
        <Select
          label={TEXT.workspace}
          value={name ?? ""}
          options={[
            ["", list.value.workspaces.length > 0 ? TEXT.chooseWorkspace : TEXT.noneStored],
            ...list.value.workspaces.map((one) => [one.name, one.name] as const),
          ]}
          onChoose={choose}
        />
        {name !== undefined && (
          <Button
            changes
            look="edge"
            words={TEXT.save}
            onClick={() =>
              void run(
                () => saveAs(session, deps.store.devices.peek(), name, current.peek()?.revision),
                TEXT.saved(name),
              )
            }
          />
        )}
      </div>
      <SaveNew session={session} deps={deps} run={run} />
      {problem.value && <ProblemNote problem={problem.value} />}
      {problem.value?.kind === "changed" && name !== undefined && (
        <Conflict session={session} deps={deps} name={name} run={run} />
      )}
      {problems.value.map((text) => (
        <p key={text} class="problem" role="alert">
          {text}
        </p>
      ))}
      <p class="stored-said mid text-xs" role="status">
        {said.value}
      </p>
      <Slot name="workspaceCompanions" with={{ session, deps, said }} />
      <More session={session} deps={deps} list={list} run={run} said={said} />
    </div>
  );
}

type Run = (act: () => Promise<HttpProblem | undefined>, done: string) => Promise<void>;

/** Characters of a name that the server takes. */
const MAX_NAME = 80;

function SaveNew({ session, deps, run }: Props & { readonly run: Run }) {
  const text = useSignal("");
  const save = async (event: Event): Promise<void> => {
    event.preventDefault();
    const name = text.peek().trim();
    if (name === "") return;
    await run(() => saveAs(session, deps.store.devices.peek(), name, undefined), TEXT.saved(name));
    if (currentOf(session).peek()?.name === name) text.value = "";
  };
  return (
    <form class="stored-row control-row" onSubmit={(event) => void save(event)}>
      <span class="field">
        <input
          value={text}
          maxLength={MAX_NAME}
          aria-label={TEXT.newName}
          placeholder={TEXT.newName}
          onInput={(event) => (text.value = event.currentTarget.value)}
        />
      </span>
      <Button changes type="submit" look="edge" words={TEXT.saveNew} disabled={text.value.trim() === ""} />
      {text.value.length >= MAX_NAME && (
        <small class="dim" role="status">
          {TEXT.longest(MAX_NAME)}
        </small>
      )}
    </form>
  );
}

/** Another user has saved the workspace since: nothing is replaced without confirmation. */
function Conflict({ session, deps, name, run }: Props & { readonly name: string; readonly run: Run }) {
  return (
    <div class="stored-row control-row">
      <Button
        look="edge"
        words={TEXT.openNewer}
        onClick={() => void run(() => openStored(session, name), TEXT.opened(name))}
      />
      <Button
        changes
        look="edge"
        words={TEXT.replaceWithMine}
        onClick={() => void run(() => saveAs(session, deps.store.devices.peek(), name, "*"), TEXT.saved(name))}
      />
    </div>
  );
}

interface MoreProps extends Props {
  readonly list: Signal<WorkspaceList>;
  readonly run: Run;
  readonly said: Signal<string>;
}

function More({ session, deps, list, run, said }: MoreProps) {
  const save = async (): Promise<void> => {
    said.value = await exportFile(session, deps.store.devices.peek());
  };
  const name = currentOf(session).value?.name;
  const family = selected(deps)?.protocol ?? "";
  const title = protocolOf(family)?.title ?? family;
  const isDefault = name !== undefined && list.value.defaults[family] === name;
  const pick = (event: Event): void => {
    const input = event.currentTarget;
    if (!(input instanceof HTMLInputElement)) return;
    const file = input.files?.[0];
    said.value = ""; // what was done before
    if (file) void importFile(session, file);
    input.value = ""; // the same file can be chosen again
  };
  return (
    <details>
      <summary>{TEXT.more}</summary>
      <div class="stored-row control-row">
        <Button look="edge" words={TEXT.exportFile} onClick={() => void save()} />
        <label class="btn edge">
          {TEXT.importFile}
          <input type="file" class="visually-hidden" accept=".json,application/json" onChange={pick} />
        </label>
        {name !== undefined && (
          <Button
            changes
            look="edge"
            words={TEXT.remove}
            onClick={() => void run(() => removeStored(session), TEXT.deleted(name))}
          />
        )}
      </div>
      {name !== undefined && family !== "" && (
        <label class="stored-check flex-row text-sm">
          <input
            disabled={isViewOnly.value}
            type="checkbox"
            checked={isDefault}
            onChange={() =>
              void run(() => setDefault(family, isDefault ? null : name), isDefault ? "" : TEXT.isDefaultNow(title))
            }
          />
          {TEXT.openFamilyWith(title)}
        </label>
      )}
    </details>
  );
}
