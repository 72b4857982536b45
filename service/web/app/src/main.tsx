import { render } from "preact";
import { App } from "./App";
import { loadWords } from "./i18n";
import "./style.css";

const theme = localStorage.getItem("theme");
if (theme) document.documentElement.dataset.theme = theme;
void loadWords().then(() => render(<App />, document.getElementById("app")!));
