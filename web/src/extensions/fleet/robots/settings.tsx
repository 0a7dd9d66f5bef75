/** Settings of a robot against the profile of its group: what differs, and making them the profile. */
import { useSignal } from "@preact/signals";
import { dateWords } from "../../../recordings/library-filter";
import { Button } from "../../../ui/controls/button";
import { type Outcome, request } from "../../../requests/http";
import { Answered, useAnswer } from "../../../requests/use-answer";
import type { DeviceSettingsCheck, RobotSummary } from "../../../wire/routes";
import type { Fleet } from "./fleet-state";
import { GroupRollout } from "./group-rollout";
import { PersonForm } from "./person-form";
import { late } from "../../../ui/dom/late";
import { TableHead } from "../../../ui/controls/table-head";
import { TEXT } from "./texts";

const RolloutDialog = late(async () => (await import("./rollout-dialog")).RolloutDialog);

type Answer = Outcome<readonly DeviceSettingsCheck[]>;

export function SettingsCheck({ robot, fleet }: { readonly robot: RobotSummary; readonly fleet: Fleet }) {
  const isOpen = useSignal(false);
  const rolling = useSignal<{ readonly device: string; readonly rollout: number | undefined } | undefined>(undefined);
  const shown = [robot.name, robot.settings, robot.drifted, ...robot.devices.map((one) => one.settings)].join(" ");
  const asked = useAnswer(isOpen.value ? shown : "", () =>
    request("GET /api/fleet/robots/{robot}/settings", { path: { robot: robot.name } }),
  );
  const settings = (
    <details
      class="fleet-events fleet-settings"
      onToggle={(event) => {
        isOpen.value = event.currentTarget.open;
      }}
    >
      <summary>{TEXT.compare}</summary>
      <Answered of={asked}>
        {(checks) => (
          <>
            {checks.length === 0 && <p class="dim">{TEXT.noDevice}</p>}
            {checks.map((check) => (
              <section key={check.device}>
                <h4>{check.name}</h4>
                <Check check={check} />
                {check.profile && (
                  <GroupRollout
                    robot={robot}
                    device={check.device}
                    open={(rollout) => (rolling.value = { device: check.device, rollout })}
                    isShown={rolling.value !== undefined}
                  />
                )}
                <Profile
                  check={check}
                  send={async (change) => {
                    const isMade = await asked.send(change);
                    if (isMade) fleet.retry();
                    return isMade;
                  }}
                  robot={robot.name}
                />
              </section>
            ))}
          </>
        )}
      </Answered>
    </details>
  );
  return (
    <>
      {settings}
      {rolling.value && (
        <RolloutDialog
          {...rolling.value}
          robot={robot.name}
          group={robot.group}
          onClose={() => {
            rolling.value = undefined;
            fleet.retry();
          }}
        />
      )}
    </>
  );
}

function Check({ check }: { readonly check: DeviceSettingsCheck }) {
  const { rows, profile, read, why, same, missing } = check;
  const skipped = Object.entries(missing);
  return (
    <>
      {why !== "" && <p class="dim">{why}</p>}
      {rows.length > 0 && (
        <table class="profile-table">
          <TableHead of={[TEXT.settingTitle, TEXT.profileTitle, TEXT.robotTitle]} />
          <tbody>
            {rows.map(({ title, profile: right, robot: left }) => (
              <tr key={title}>
                <td>{title}</td>
                <td>{right || TEXT.nothingValue}</td>
                <td class="warn">{left || TEXT.nothingValue}</td>
              </tr>
            ))}
          </tbody>
        </table>
      )}
      {profile && why === "" && <p class="dim">{TEXT.sameSettings(same)}</p>}
      {skipped.length > 0 && (
        <p class="dim" title={skipped.map(([name, text]) => `${name}: ${text}`).join("\n")}>
          {TEXT.notCompared(skipped.length)}
        </p>
      )}
      {profile && <p class="dim">{TEXT.profileOf(profile.robot, profile.by, dateWords(profile.time))}</p>}
      {read !== null && <p class="dim">{TEXT.readAt(dateWords(read))}</p>}
    </>
  );
}

interface ProfileProps {
  readonly check: DeviceSettingsCheck;
  readonly robot: string;
  readonly send: (change: Promise<Answer>) => Promise<boolean>;
}

function Profile({ check: { device, profile, read }, robot, send }: ProfileProps) {
  const asking = useSignal<"use" | "remove" | undefined>(undefined);
  const submit = async (by: string): Promise<void> => {
    const path = { robot };
    const change =
      asking.peek() === "use"
        ? request("POST /api/fleet/robots/{robot}/profile", { path, body: { device, by } })
        : request("DELETE /api/fleet/robots/{robot}/profile", { path, query: { device, by } });
    if (await send(change)) asking.value = undefined;
  };
  if (asking.value === undefined) {
    return (
      <div class="fleet-profile control-row">
        {read !== null && <Button changes look="edge" words={TEXT.useProfile} onClick={() => (asking.value = "use")} />}
        {profile && <Button changes words={TEXT.removeProfile} onClick={() => (asking.value = "remove")} />}
      </div>
    );
  }
  return (
    <PersonForm
      title={asking.value === "use" ? TEXT.useProfile : TEXT.removeProfile}
      hint={asking.value === "use" ? TEXT.useProfileHint : ""}
      send={submit}
      cancel={() => (asking.value = undefined)}
    />
  );
}
