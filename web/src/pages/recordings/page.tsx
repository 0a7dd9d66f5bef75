/** The Recordings page: the library, or an open recording. Loaded on first use. */
import type { App } from "../../page/context";
import { reopened, route } from "../../page/route";
import { LibraryPage } from "./library";
import { OpenPage } from "./open-page";
import "./library.css";
import "./details.css";
import "./phone.css";
import "./replay.css";

export function RecordingsPage({ app }: { readonly app: App }) {
  const id = route.value.recording;
  return id === undefined ? <LibraryPage app={app} /> : <OpenPage key={id + reopened.value} id={id} app={app} />;
}
