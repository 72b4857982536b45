import type { ComponentChildren } from "preact";
import { remove, type Session } from "../api/client";
import { choose, language, languages, named, t } from "../i18n";
import { FullStorage } from "./FullStorage";

interface ShellProps {
  session: Session;
  path: string[];
  signedOut: () => void;
  languageChanged: () => void;
  children: ComponentChildren;
}

function turnTheme(): void {
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const now = document.documentElement.dataset.theme ?? (dark ? "dark" : "light");
  const next = now === "dark" ? "light" : "dark";
  document.documentElement.dataset.theme = next;
  localStorage.setItem("theme", next);
}

const own = (code: string) => new Intl.DisplayNames([code], { type: "language" }).of(code) ?? code;

/** What every page stands in: the way to the others, the language, light or dark, and out. */
export function Shell({ session, path, signedOut, languageChanged, children }: ShellProps) {
  const admin = session.role === "admin";
  const pages = [
    ["", "nav.overview", true],
    ["jobs", "nav.jobs", true],
    ["fleet", "nav.fleet", true],
    ["audit", "nav.audit", admin],
    ["keys", "nav.keys", admin && !session.map_ids],
    ["system", "nav.system", true],
  ] as const;
  const here = path[0] === "maps" ? "" : (path[0] ?? "");
  const leave = async () => {
    await remove("/v1/session");
    signedOut();
  };
  return (
    <>
      <a
        class="skip"
        href="#content"
        onClick={(event) => {
          event.preventDefault();
          document.getElementById("content")?.focus();
        }}
      >
        {t("nav.skip")}
      </a>
      <header class="bar">
        <a class="brand" href="#/">
          <img src="/icon.svg" alt="" width={28} height={28} />
          Groundplan
        </a>
        {session.role !== "robot" && (
          <nav aria-label={t("nav.label")}>
            {pages
              .filter(([, , offered]) => offered)
              .map(([at, name]) => (
                <a key={at} href={`#/${at}`} aria-current={here === at ? "page" : undefined}>
                  {t(name)}
                </a>
              ))}
            <a href="/tablet">{t("nav.tablet")}</a>
          </nav>
        )}
        <span class="spread" />
        <span class="who">{named("role", session.role)}</span>
        <select
          aria-label={t("language.choose")}
          value={language}
          onChange={(event) => void choose(event.currentTarget.value).then(languageChanged)}
        >
          {languages.map((code) => (
            <option key={code} value={code}>
              {own(code)}
            </option>
          ))}
        </select>
        <button class="plain" type="button" onClick={turnTheme} aria-label={t("theme")} title={t("theme")}>
          ◐
        </button>
        <button class="plain" type="button" onClick={() => void leave()}>
          {t("signOut")}
        </button>
      </header>
      <main id="content" tabIndex={-1}>
        <FullStorage />
        {children}
      </main>
    </>
  );
}
