/** A revision from above: its occupancy grid, as the service writes it for Nav2. */
import { get } from "../api/client";

export interface Grid {
  /** What is occupied is dark, what is free white; the first row is the farthest in y. */
  picture: ImageData;
  /** Edge of a cell [m]. */
  resolution: number;
  /** The corner with the least x and y [m], frame `map`. */
  low: [number, number];
  high: [number, number];
}

const HEADER = /^P5\s+(\d+)\s+(\d+)\s+255\s/;
const OCCUPIED = 100;

function pictureOf(bytes: Uint8Array): ImageData {
  const found = HEADER.exec(new TextDecoder("latin1").decode(bytes.subarray(0, 64)));
  if (!found) throw new Error("The occupancy grid is no binary PGM picture.");
  const [width, height] = [Number(found[1]), Number(found[2])];
  const pixels = new Uint32Array(width * height);
  const cells = bytes.subarray(found[0].length);
  for (let k = 0; k < pixels.length; k++) pixels[k] = cells[k]! < OCCUPIED ? 0xff3a2a1e : 0x00ffffff;
  return new ImageData(new Uint8ClampedArray(pixels.buffer), width, height);
}

export async function loadGrid(mapId: string, n: number): Promise<Grid> {
  const at = `/v1/maps/${mapId}/revisions/${n}/artifacts/occupancy-grid`;
  const [picture, description] = await Promise.all([
    get.bytes(`${at}.pgm`).then((buffer) => pictureOf(new Uint8Array(buffer))),
    get.text(`${at}.yaml`),
  ]);
  const resolution = Number(/resolution: (\S+)/.exec(description)![1]);
  const [x, y] = /origin: \[([^,]+), ([^,]+)/.exec(description)!.slice(1).map(Number) as [number, number];
  return { picture, resolution, low: [x, y], high: [x + picture.width * resolution, y + picture.height * resolution] };
}
