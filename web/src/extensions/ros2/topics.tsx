/** The ROS 2 topics of a device: types, subscribers and rates, each with a switch. */
import { bytes } from "../../recordings/library-filter";
import { Dialog } from "../../ui/controls/dialog";
import { rate } from "../../ui/format/format";
import { request } from "../../requests/http";
import { Message } from "../../ui/controls/message";
import { Answered, useAnswer } from "../../requests/use-answer";
import { fullName } from "../../wire/device-name";
import type { MissingTopic, RosState, RosTopic } from "../../wire/routes";
import type { DeviceInfo } from "../../wire/types";
import { isViewOnly } from "../../wire/capabilities";
import { TEXT } from "./texts";
import "./topics.css";

const ASK_EVERY_MS = 1000;

interface Props {
  readonly device: DeviceInfo;
  readonly onClose: () => void;
}

export function RosTopics({ device, onClose }: Props) {
  const topics = useAnswer(device.id, () => request("GET /api/ros2"), { everyMs: ASK_EVERY_MS });
  const flip = ({ key, enabled }: RosTopic): void =>
    void topics.send(request("PATCH /api/ros2/topics", { body: { key, enabled: !enabled } }));
  return (
    <Dialog title={TEXT.topicsOf(fullName(device))} onClose={onClose}>
      <div class="ros-topics stacked">
        <Answered of={topics}>{(state) => <State state={state} device={device.id} flip={flip} />}</Answered>
      </div>
    </Dialog>
  );
}

interface StateProps {
  readonly state: RosState;
  readonly device: string;
  readonly flip: (topic: RosTopic) => void;
}

function State({ state, device, flip }: StateProps) {
  if (!state.enabled)
    return (
      <p>
        <Message text={TEXT.notPublished} />
      </p>
    );
  const topics = state.topics.filter((topic) => topic.device === device);
  const missing = state.missing.filter((topic) => topic.device === device);
  return (
    <>
      <p role="status">
        <span class={`dot ${state.connected ? "live" : "bad"}`} /> {TEXT.publishedAt(state.router, state.domain)}{" "}
        {state.connected ? TEXT.connected : state.problem || TEXT.notConnected}{" "}
        {state.hint !== "" && <Message text={state.hint} />}
      </p>
      {state.dropped > 0 && <p class="tag warn">{TEXT.dropped(state.dropped)}</p>}
      {topics.length === 0 ? (
        <p class="dim">{TEXT.noTopics}</p>
      ) : (
        <ul>
          {topics.map((topic) => (
            <Topic key={topic.key} topic={topic} flip={flip} />
          ))}
        </ul>
      )}
      {missing.length > 0 && <Missing topics={missing} />}
    </>
  );
}

function Topic({ topic, flip }: { readonly topic: RosTopic; readonly flip: StateProps["flip"] }) {
  const sent = bytes(topic.bytes);
  return (
    <li class="ros-topic text-sm">
      <label class="ros-topic-head flex-row">
        <input
          disabled={isViewOnly.value}
          type="checkbox"
          role="switch"
          aria-label={TEXT.publish(topic.name)}
          checked={topic.enabled}
          aria-checked={topic.enabled}
          onChange={() => flip(topic)}
        />
        <b class="mono">{topic.name}</b>
      </label>
      <p class="mono dim">{topic.type}</p>
      {topic.enabled && (
        <p>
          {topic.subscribers === 0 ? TEXT.nobodySubscribes : TEXT.subscribers(topic.subscribers)}
          {topic.subscribers > 0 && ` · ${TEXT.rate(rate(topic.rate))}`}
          {topic.messages > 0 && ` · ${TEXT.messages(topic.messages)} · ${sent.value} ${sent.unit}`}
        </p>
      )}
      {topic.problem !== "" && (
        <p class="tag warn">
          <Message text={topic.problem} />
        </p>
      )}
    </li>
  );
}

function Missing({ topics }: { readonly topics: readonly MissingTopic[] }) {
  return (
    <section aria-label={TEXT.missing}>
      <h3>{TEXT.missing}</h3>
      <dl>
        {topics.map(({ topic, reason }) => (
          <div key={topic}>
            <dt class="mono">{topic}</dt>
            <dd class="dim">
              <Message text={reason} />
            </dd>
          </div>
        ))}
      </dl>
    </section>
  );
}
