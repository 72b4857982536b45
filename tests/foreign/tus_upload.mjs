// One upload by tus-js-client, as a web page or a Node program of others does it; its story as JSON on stdout.
// usage: node tus_upload.mjs CLIENT-FOLDER < order.json
import { createReadStream, readFileSync } from "node:fs";
import { createRequire } from "node:module";

const require = createRequire(`${process.argv[2]}/`);
const tus = require("tus-js-client");
const order = JSON.parse(readFileSync(0, "utf8"));
const story = { requests: [], ended: null, problem: null, url: null, resumedFrom: null, retries: 0 };

function input() {
  return order.stream ? createReadStream(order.file) : readFileSync(order.file);
}

function upload(urlStorage, settle) {
  const made = new tus.Upload(input(), {
    endpoint: order.endpoint,
    headers: order.headers,
    retryDelays: order.retryDelays ?? null,
    urlStorage,
    storeFingerprintForResuming: Boolean(order.storage),
    fingerprint: async () => `fingerprint-of-${order.file}`,
    ...order.options,
    onAfterResponse(request, response) {
      const method = request.getMethod();
      story.requests.push([method, response.getStatus()]);
      for (const name of ["Groundplan-Result", "Groundplan-Job", "Upload-Metadata"]) {
        const value = response.getHeader(name);
        if (value) story[name] = value;
      }
    },
    onShouldRetry(error, attempt) {
      story.retries += 1;
      const status = error.originalResponse ? error.originalResponse.getStatus() : 0;
      return attempt < 60 && (status === 0 || status === 409 || status === 423);
    },
    onChunkComplete(size, accepted, total) {
      if (order.stopAfter && accepted >= order.stopAfter && accepted < total && story.resumedFrom === null) {
        made.abort(Boolean(order.terminate)).then(() => settle("stopped"), settle);
      }
    },
    onSuccess: () => settle("done"),
    onError: settle,
  });
  return made;
}

function run(urlStorage, begin) {
  return new Promise((resolve) => {
    const made = upload(urlStorage, (how) => {
      if (how instanceof Error) {
        story.problem = how.originalResponse ? JSON.parse(how.originalResponse.getBody() || "null") : String(how);
      }
      story.ended = how instanceof Error ? "refused" : how;
      story.url = made.url;
      resolve();
    });
    begin(made);
  });
}

const storage = order.storage ? new tus.FileUrlStorage(order.storage) : undefined;
await run(storage, (made) => made.start());
if (order.thenResume) {
  await run(storage, async (made) => {
    const [previous] = await made.findPreviousUploads();
    made.resumeFromPreviousUpload(previous);
    story.resumedFrom = previous.uploadUrl;
    made.start();
  });
}
process.stdout.write(JSON.stringify(story));
