import { render } from "preact";
import { App } from "./App";
import { loadWords } from "./i18n";
import "./style.css";

const theme = localStorage.getItem("theme");
if (theme) document.documentElement.dataset.theme = theme;
loadWords().then(() => render(<App />, document.getElementById("app")!));
