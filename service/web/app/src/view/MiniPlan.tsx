/** A small picture from above of the map, and of the scan at one pose. */
import { useEffect, useRef } from "preact/hooks";
import type { Matrix } from "../api/told";
import type { Cloud } from "./cloud";

const [WIDTH, HEIGHT] = [220, 150];
const MOST = 6000;

interface MiniPlanProps {
  map: Cloud;
  scan: Cloud;
  T: Matrix;
  label: string;
}

export function MiniPlan({ map, scan, T, label }: MiniPlanProps) {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const pen = canvas.current!.getContext("2d")!;
    const scale = 0.94 * Math.min(WIDTH / (map.high[0] - map.low[0]), HEIGHT / (map.high[1] - map.low[1]));
    const dot = (x: number, y: number, size: number) =>
      pen.fillRect(WIDTH / 2 + (x - map.centre[0]) * scale, HEIGHT / 2 - (y - map.centre[1]) * scale, size, size);
    pen.fillStyle = "#ffffff";
    pen.fillRect(0, 0, WIDTH, HEIGHT);
    const each = (cloud: Cloud, show: (x: number, y: number, z: number) => void) => {
      const step = 3 * Math.max(1, Math.ceil(cloud.xyz.length / 3 / MOST));
      for (let k = 0; k + 2 < cloud.xyz.length; k += step) show(cloud.xyz[k]!, cloud.xyz[k + 1]!, cloud.xyz[k + 2]!);
    };
    pen.fillStyle = "#52708f";
    each(map, (x, y, z) => z > map.low[2] + 0.3 && dot(x, y, 1));
    pen.fillStyle = "#e65100";
    each(scan, (x, y, z) =>
      dot(
        T[0]![0]! * x + T[0]![1]! * y + T[0]![2]! * z + T[0]![3]!,
        T[1]![0]! * x + T[1]![1]! * y + T[1]![2]! * z + T[1]![3]!,
        1.4,
      ),
    );
  }, [map, scan, T]);
  return <canvas ref={canvas} width={WIDTH} height={HEIGHT} role="img" aria-label={label} />;
}
