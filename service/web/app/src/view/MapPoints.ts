/** A map's points on a stage: few from afar, all of them near by, never more than 200,000. */
import {
  Box3,
  BufferAttribute,
  BufferGeometry,
  type Camera,
  Color,
  Frustum,
  Group,
  InterleavedBuffer,
  InterleavedBufferAttribute,
  Matrix4,
  OrthographicCamera,
  Points,
  PointsMaterial,
  type Ray,
  Sphere,
  Vector3,
} from "three";
import type { Cloud } from "./cloud";
import { placeOf, type MapCloud, type OctreeNode, type Records } from "./octree";

const CUT_ABOVE_M = 0.3;
const CELLS = 64;
const FINE_ENOUGH_PX = 1;
const AT_ONCE = 4;
const SETTLE_MS = 120;
const BEHIND_M = 0.1;
const LEAST_REACH_M = 0.02;

type Shown = Points<BufferGeometry, PointsMaterial>;

/** Blue below to pale above, so that walls read as walls. */
function coloursOf(
  heights: (k: number) => number,
  count: number,
  { low, high }: Cloud,
  dark: boolean,
): BufferAttribute {
  const [floor, top] = dark
    ? [new Color("#3b6ea5"), new Color("#c9def5")]
    : [new Color("#a9c3df"), new Color("#0b3763")];
  const colours = new Float32Array(3 * count);
  const span = Math.max(0.1, high[2] - low[2]);
  const mixed = new Color();
  for (let k = 0; k < count; k++) {
    const above = heights(k) - low[2];
    mixed.lerpColors(floor, top, Math.min(1, above / span + (above > CUT_ABOVE_M ? 0.25 : 0))).toArray(colours, 3 * k);
  }
  return new BufferAttribute(colours, 3);
}

export class MapPoints {
  readonly group = new Group();
  private readonly material = new PointsMaterial({ size: 2, sizeAttenuation: false, vertexColors: true });
  private readonly shown = new Map<OctreeNode, { points: Shown; records: Records }>();
  private readonly loading = new Map<OctreeNode, AbortController>();
  private readonly whole: Shown | null = null;
  private readonly most: number;
  private wanted: OctreeNode[] = [];
  private settling = 0;

  /** `changed` is told when other points are shown than before; `most` is how many may be held. */
  constructor(
    private readonly map: MapCloud,
    private readonly dark: boolean,
    most: number,
    private readonly changed: () => void,
  ) {
    this.most = most - map.overview.xyz.length / 3;
    for (const [node, records] of map.first) this.show(node, records);
    if (map.octree) return;
    const { overview } = map;
    const geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(overview.xyz, 3));
    geometry.setAttribute(
      "color",
      coloursOf((k) => overview.xyz[3 * k + 2]!, overview.xyz.length / 3, overview, dark),
    );
    this.whole = new Points(geometry, this.material);
    this.group.add(this.whole);
  }

  /** How many points are held, the overview's included. */
  get held(): number {
    let sum = this.map.overview.xyz.length / 3;
    for (const node of this.shown.keys()) sum += node.count;
    return sum;
  }

  /** Whether all that the view asks for is shown. */
  get settled(): boolean {
    return this.settling === 0 && this.loading.size === 0;
  }

  /** See to it that what a camera sees is shown in the detail that its picture can show. */
  look(camera: Camera, heightPx: number): void {
    if (!this.map.octree) return;
    clearTimeout(this.settling);
    this.settling = window.setTimeout(() => {
      this.settling = 0;
      this.choose(camera, heightPx);
    }, SETTLE_MS);
  }

  /**
   * The point of the whole cloud that a ray meets, or null: the nearest to the ray among the foremost within
   * `reach(distance)` metres of it. Nodes that are not shown are loaded around it, one after the other.
   */
  async pick(ray: Ray, reach: (distance: number) => number): Promise<Vector3 | null> {
    const near = new Nearest(ray, reach);
    if (this.whole) near.takeCloud(this.map.overview);
    for (const [node, { records }] of this.shown) near.take(node, records);
    const found = near.best();
    if (!found || !this.map.octree) return found;
    const around = new Sphere(found, Math.max(LEAST_REACH_M, 2 * reach(found.distanceTo(ray.origin))));
    const full = new Nearest(ray, reach);
    for (const node of within(this.map.octree.root, around)) {
      full.take(node, this.shown.get(node)?.records ?? (await this.map.octree.load(node)));
    }
    return full.best() ?? found;
  }

  leave(): void {
    clearTimeout(this.settling);
    for (const stop of this.loading.values()) stop.abort();
    for (const node of [...this.shown.keys()]) this.drop(node);
    this.whole?.geometry.dispose();
    this.material.dispose();
  }

  private choose(camera: Camera, heightPx: number): void {
    const frustum = new Frustum().setFromProjectionMatrix(
      new Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse),
    );
    const queue: { node: OctreeNode; px: number }[] = [{ node: this.map.octree!.root, px: Infinity }];
    const wanted: OctreeNode[] = [];
    let sum = 0;
    while (queue.length > 0) {
      const { node } = queue.shift()!;
      if (sum + node.count > this.most) break;
      sum += node.count;
      if (node.count > 0) wanted.push(node);
      for (const child of node.children) {
        const px = cellPx(node, child, camera, heightPx);
        if (px < FINE_ENOUGH_PX || !frustum.intersectsBox(boxOf(child))) continue;
        const at = queue.findIndex((other) => other.px < px);
        queue.splice(at < 0 ? queue.length : at, 0, { node: child, px });
      }
    }
    const keep = new Set(wanted);
    for (const [node, stop] of [...this.loading]) {
      if (keep.has(node)) continue;
      stop.abort();
      this.loading.delete(node);
    }
    for (const node of [...this.shown.keys()]) if (!keep.has(node)) this.drop(node);
    this.wanted = wanted.filter((node) => !this.shown.has(node) && !this.loading.has(node));
    this.changed();
    while (this.loading.size < AT_ONCE && this.wanted.length > 0) this.loadNext();
  }

  private loadNext(): void {
    const node = this.wanted.shift();
    if (!node) return;
    const stop = new AbortController();
    this.loading.set(node, stop);
    this.map
      .octree!.load(node, stop.signal)
      .then(
        (records) => {
          if (this.loading.get(node) === stop) this.show(node, records);
        },
        () => undefined,
      )
      .finally(() => {
        if (this.loading.get(node) !== stop) return;
        this.loading.delete(node);
        this.loadNext();
        this.changed();
      });
  }

  private show(node: OctreeNode, records: Records): void {
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new InterleavedBufferAttribute(new InterleavedBuffer(records, 4), 3, 0, true));
    geometry.setAttribute(
      "color",
      coloursOf((k) => placeOf(node, records, k, 2), node.count, this.map.overview, this.dark),
    );
    geometry.boundingSphere = new Sphere(new Vector3(0.5, 0.5, 0.5), 0.9);
    const points = new Points(geometry, this.material);
    points.position.set(...node.low);
    points.scale.setScalar(node.edge);
    this.group.add(points);
    this.shown.set(node, { points, records });
  }

  private drop(node: OctreeNode): void {
    const { points } = this.shown.get(node)!;
    this.group.remove(points);
    points.geometry.dispose();
    this.shown.delete(node);
  }
}

const boxOf = ({ low, edge }: OctreeNode): Box3 => new Box3(new Vector3(...low), new Vector3(...low).addScalar(edge));

/** How many pixels lie between the points of a node, where its child is. */
function cellPx(node: OctreeNode, child: OctreeNode, camera: Camera, heightPx: number): number {
  const metres = node.edge / CELLS;
  const perspective = camera.projectionMatrix.elements[5] * 0.5 * heightPx;
  if (camera instanceof OrthographicCamera) return metres * perspective;
  return (metres * perspective) / Math.max(0.1, boxOf(child).distanceToPoint(camera.position));
}

/** The nodes with points, whose cubes a sphere meets. */
function within(node: OctreeNode, sphere: Sphere): OctreeNode[] {
  if (!sphere.intersectsBox(boxOf(node))) return [];
  const below = node.children.flatMap((child) => within(child, sphere));
  return node.count > 0 ? [node, ...below] : below;
}

/** The points near a ray. */
class Nearest {
  private readonly found: { x: number; y: number; z: number; along: number; off: number }[] = [];

  constructor(
    private readonly ray: Ray,
    private readonly reach: (distance: number) => number,
  ) {}

  take(node: OctreeNode, records: Records): void {
    for (let k = 0; k < node.count; k++)
      this.see(placeOf(node, records, k, 0), placeOf(node, records, k, 1), placeOf(node, records, k, 2));
  }

  takeCloud({ xyz }: Cloud): void {
    for (let k = 0; k < xyz.length; k += 3) this.see(xyz[k]!, xyz[k + 1]!, xyz[k + 2]!);
  }

  best(): Vector3 | null {
    const foremost = this.found.reduce((least, { along }) => Math.min(least, along), Infinity);
    const near = this.found.filter(({ along }) => along <= foremost + BEHIND_M);
    const [best] = near.sort((left, right) => left.off - right.off);
    return best ? new Vector3(best.x, best.y, best.z) : null;
  }

  private see(x: number, y: number, z: number): void {
    const { origin, direction } = this.ray;
    const [dx, dy, dz] = [x - origin.x, y - origin.y, z - origin.z];
    const along = dx * direction.x + dy * direction.y + dz * direction.z;
    if (along <= 0) return;
    const off = Math.sqrt(Math.max(0, dx * dx + dy * dy + dz * dz - along * along));
    if (off <= this.reach(along)) this.found.push({ x, y, z, along, off });
  }
}
