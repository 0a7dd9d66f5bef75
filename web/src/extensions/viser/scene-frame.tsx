/** The 3D scene in a frame, by viser: of live devices, or of a recording, where it follows the player. What prevents it is said in words. */
import { useEffect, useState } from "preact/hooks";
import { onFrame } from "../../data/render-loop";
import { type HttpProblem, request } from "../../requests/http";
import { Message } from "../../ui/controls/message";
import { serverRoot, socketUrl } from "../../requests/server-place";
import { theme } from "../../ui/dom/theme";
import { useAnswer } from "../../requests/use-answer";
import { Frame } from "../../views/frame";
import { headNews, type SentHead } from "./viewer-sync";
import { TEXT } from "./texts";

function Scene({ address }: { readonly address: string }) {
  const dark = theme.value === "dark" ? "?darkMode" : "";
  return <Frame address={serverRoot() + address + dark} title={TEXT.sceneByViser} />;
}

function Waiting({ problem }: { readonly problem: HttpProblem | undefined }) {
  if (!problem)
    return (
      <p class="wait" role="status">
        {TEXT.startingScene}
      </p>
    );
  return (
    <p class="wait" role="alert">
      <b>
        <Message text={problem.message} />
      </b>{" "}
      <Message text={problem.hint} />
    </p>
  );
}

/** A live scene: requested first, so that a refusal is reported in our words. */
export function Begun({ device }: { readonly device: string }) {
  const { answer, isOld, problem } = useAnswer(device, () => request("GET /api/views/scene", { query: { device } }));
  return answer === undefined || isOld ? <Waiting problem={problem} /> : <Scene address={answer.address} />;
}

/** What a scene of a recording follows. */
export interface Player {
  /** RecordingInfo.id */
  readonly recording: string;
  /** Reading position, unix s. */
  readonly head: () => number;
  /** Recorded seconds per second; 0 while paused. */
  readonly rate: () => number;
}

/** From the end of a connection to the next one, ms. */
const AGAIN_MS = 1000;

/** A scene that follows a player. It opens again after the server was started again. */
export function Following({ player }: { readonly player: Player }) {
  const [attempts, setAttempts] = useState(0);
  const [address, setAddress] = useState<string>();
  const [problem, setProblem] = useState<HttpProblem>();
  // biome-ignore lint/correctness/useExhaustiveDependencies: what is read besides is the newest, and no reason to begin again
  useEffect(() => {
    const socket = new WebSocket(socketUrl(`/ws/scene/${encodeURIComponent(player.recording)}`));
    let sent: SentHead | undefined;
    let again: ReturnType<typeof setTimeout> | undefined;
    socket.onmessage = ({ data }) => setAddress((JSON.parse(String(data)) as { readonly address: string }).address);
    socket.onclose = ({ reason }) => {
      setAddress(undefined);
      setProblem({
        kind: "closed",
        message: reason || TEXT.sceneEnded,
        hint: reason ? TEXT.reopenScene : TEXT.reopens,
        status: 0,
      });
      if (!reason) again = setTimeout(() => setAttempts(attempts + 1), AGAIN_MS);
    };
    const stop = onFrame((now) => {
      if (socket.readyState !== WebSocket.OPEN) return;
      const news = headNews(sent, { t: player.head(), rate: player.rate(), at: now / 1000 });
      if (!news) return;
      sent = news;
      socket.send(JSON.stringify({ t: news.t, rate: news.rate }));
    });
    return () => {
      stop();
      clearTimeout(again);
      socket.onclose = null;
      socket.close();
    };
  }, [attempts]);
  return address === undefined ? <Waiting problem={problem} /> : <Scene address={address} />;
}
