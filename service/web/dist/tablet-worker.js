// Keeps the page's own files, so that the tablet page opens without a network. Never touches /v1.
const KEPT = "groundplan-pages";

self.addEventListener("install", (event) => {
  self.skipWaiting();
  event.waitUntil(caches.open(KEPT).then((kept) => kept.add("/tablet")));
});
self.addEventListener("activate", (event) => event.waitUntil(self.clients.claim()));

async function fromNetworkFirst(request) {
  const kept = await caches.open(KEPT);
  try {
    const answer = await fetch(request);
    if (answer.ok) await kept.put(request, answer.clone());
    return answer;
  } catch (cause) {
    const found = await kept.match(request, { ignoreVary: true });
    if (found) return found;
    throw cause;
  }
}

async function fromKeptFirst(request) {
  return (await caches.match(request)) ?? fromNetworkFirst(request);
}

self.addEventListener("fetch", (event) => {
  const { request } = event;
  const path = new URL(request.url).pathname;
  if (request.method !== "GET" || path.startsWith("/v1/")) return;
  if (path.startsWith("/assets/")) event.respondWith(fromKeptFirst(request));
  else if (path === "/tablet" || path.startsWith("/icon") || path.startsWith("/manifest"))
    event.respondWith(fromNetworkFirst(request));
});
