// What the page shows: the clouds, and all that a person can change.
import type { Cloud, Description, Values } from "./data";
import type { Layer, View, Views } from "./scene";

/** The clip box that holds all. */
export const WHOLE: Settings["clip"] = [[0, 1], [0, 1], [0, 1]];

/** What a person can change. */
interface Settings {
  /** The key of the values that colours show, or one of the colourings of colouring.ts that no single list holds. */
  colouring: string;
  shading: string;
  /** Factor of the points' radii. */
  size: number;
  /** The end of the axis that points up: x, y, z, -x, -y or -z. */
  up: string;
  /** How many points of each result are shown, the first ones. */
  first: number;
  /** Whether surfaces are shown in place of points, where there are some. */
  meshes: boolean;
  /** The clouds that stand side by side. */
  shown: ReadonlySet<number>;
  /** Whether two clouds share one view instead, left and right of the divider. */
  swiping: boolean;
  left: number;
  right: number;
  /** Where the divider stands, from 0 to 1. */
  divider: number;
  /** Width of the clouds as they were seen from the last direction looked from, divided by their height. */
  shape: number;
  picked: Place | null;
  /** The ends of the colour scales that a person has set, by key. */
  ranges: ReadonlyMap<string, readonly [number, number]>;
  /** The kinds that are not shown, such as classes, by the key of their values. */
  hidden: ReadonlyMap<string, ReadonlySet<number>>;
  /** Whether only what lies in the clip box is shown. */
  clipping: boolean;
  /** The ends of the clip box along each axis, in shares of the box of the clouds. */
  clip: readonly (readonly [number, number])[];
  /** Whether a click is for a distance. */
  measuring: boolean;
  /** At most two points, whose distance is told. */
  measured: readonly Place[];
  /** The name of the figure that the plot shows. */
  plotted: string;
}

/** A point: of which cloud, and where in its arrays. */
export interface Place {
  cloud: number;
  index: number;
}

/** A view of a cloud. By distances its layer is the original, coloured by its distance to the cloud. */
export interface CloudView extends View {
  cloud: number;
}

export class State implements Settings {
  readonly clouds: Cloud[];
  readonly original: number; // the original's place among the clouds, -1 if there is none
  readonly longest: number; // points of the largest result
  readonly numbers = new Map<Values, Uint16Array>(); // the values that are unpacked
  readonly copies = new Map<number, Layer>(); // of the original, coloured by its distance to each result
  current: CloudView[] = [];
  coloured = ""; // which colours the layers have now
  filtered = ""; // which kinds the layers hide now
  colouring = "";
  shading = "both";
  size = 1;
  up: string;
  first: number;
  meshes: boolean;
  shown: ReadonlySet<number>;
  swiping = false;
  left: number;
  right: number;
  divider = 0.5;
  shape = 1;
  picked: Settings["picked"] = null;
  ranges: Settings["ranges"] = new Map();
  hidden: Settings["hidden"] = new Map();
  clipping = false;
  clip = WHOLE;
  measuring = false;
  measured: Settings["measured"] = [];
  plotted = "";

  constructor(
    readonly described: Description, readonly layers: Layer[], readonly views: Views,
    private readonly redrawn: (state: State) => void,
  ) {
    this.clouds = described.clouds;
    this.original = this.clouds.findIndex(({ role }) => role === "original");
    this.longest = Math.max(...this.clouds.filter(({ role }) => role !== "original").map(({ points }) => points));
    this.first = this.longest;
    this.up = described.up;
    this.meshes = described.solid;
    this.shown = new Set(this.clouds.keys());
    this.left = Math.max(0, this.original);
    this.right = this.clouds.length - 1;
  }

  /** Change some settings, and show what follows from them. */
  change(settings: Partial<Settings>): void {
    Object.assign(this, settings);
    this.redraw();
  }

  redraw(): void {
    this.redrawn(this);
  }
}
