/** What the service tells; `poe told` writes it anew. */
import type { Told } from "./types";

export const told: Told = {
 "octrees": [
  {
   "edge_m": 3.0,
   "extent_m": {
    "max": [
     3.0,
     2.0,
     1.0
    ],
    "min": [
     0.0,
     0.0,
     0.0
    ]
   },
   "format": "groundplan-octree/1",
   "frame": "map",
   "low_m": [
    0.0,
    0.0,
    0.0
   ],
   "nodes": [
    [
     0,
     0,
     0,
     0,
     3
    ]
   ],
   "points": 3
  }
 ],
 "sheets": [
  {
   "format": "groundplan-sheet/1",
   "levels": 1,
   "sha256": "2fb3359b5c3eb8d26b2869d029f80b20e761181d59f1f9150dd178dc519046ce",
   "size_px": [
    400,
    300
   ],
   "tile_px": 512,
   "tiles": [
    [
     0,
     0,
     0,
     196
    ]
   ]
  }
 ],
 "strokes": [
  {
   "features": [
    {
     "geometry": {
      "coordinates": [
       [
        0.0,
        0.0
       ],
       [
        4.0,
        0.0
       ],
       [
        4.0,
        3.0
       ]
      ],
      "type": "LineString"
     },
     "properties": {
      "confidence": 1.0,
      "faces": [
       [
        [
         0.0,
         0.1
        ],
        [
         3.9,
         0.1
        ],
        [
         3.9,
         3.0
        ]
       ],
       [
        [
         0.0,
         -0.1
        ],
        [
         4.1,
         -0.1
        ],
        [
         4.1,
         3.0
        ]
       ]
      ],
      "id": "w0.00_-10.00_410.00_300.00",
      "kind": "wall",
      "layer": "wall",
      "reason": "two faces, or one filled bar, as far apart as a wall is thick",
      "thickness_m": 0.2
     },
     "type": "Feature"
    },
    {
     "geometry": {
      "coordinates": [
       [
        [
         1.0,
         1.0
        ],
        [
         1.4,
         1.0
        ],
        [
         1.4,
         1.4
        ],
        [
         1.0,
         1.4
        ],
        [
         1.0,
         1.0
        ]
       ]
      ],
      "type": "Polygon"
     },
     "properties": {
      "id": "c100.00_100.00_140.00_140.00",
      "kind": "column",
      "layer": "column",
      "reason": "a solid outline that is too short for a wall"
     },
     "type": "Feature"
    }
   ],
   "frame": "drawing",
   "type": "FeatureCollection",
   "unit": "m"
  },
  {
   "features": [
    {
     "geometry": {
      "coordinates": [
       [
        [
         1.0,
         1.0
        ],
        [
         2.0,
         2.0
        ]
       ]
      ],
      "type": "MultiLineString"
     },
     "properties": {
      "id": "s100.00_100.00_200.00_200.00",
      "layer": "text",
      "reason": "small"
     },
     "type": "Feature"
    }
   ],
   "frame": "drawing",
   "type": "FeatureCollection",
   "unit": "m"
  },
  {
   "features": [
    {
     "geometry": {
      "coordinates": [
       [
        0.0,
        0.0
       ],
       [
        4.0,
        0.0
       ],
       [
        4.0,
        3.0
       ]
      ],
      "type": "LineString"
     },
     "properties": {
      "confidence": 1.0,
      "faces": [
       [
        [
         0.0,
         0.1
        ],
        [
         3.9,
         0.1
        ],
        [
         3.9,
         3.0
        ]
       ],
       [
        [
         0.0,
         -0.1
        ],
        [
         4.1,
         -0.1
        ],
        [
         4.1,
         3.0
        ]
       ]
      ],
      "id": "w0.00_397.00_4.10_400.10",
      "kind": "wall",
      "layer": "wall",
      "reason": "two faces, or one filled bar, as far apart as a wall is thick",
      "thickness_px": 0.2
     },
     "type": "Feature"
    },
    {
     "geometry": {
      "coordinates": [
       [
        [
         1.0,
         1.0
        ],
        [
         1.4,
         1.0
        ],
        [
         1.4,
         1.4
        ],
        [
         1.0,
         1.4
        ],
        [
         1.0,
         1.0
        ]
       ]
      ],
      "type": "Polygon"
     },
     "properties": {
      "id": "c1.00_398.60_1.40_399.00",
      "kind": "column",
      "layer": "column",
      "reason": "a solid outline that is too short for a wall"
     },
     "type": "Feature"
    }
   ],
   "frame": "drawing",
   "type": "FeatureCollection",
   "unit": "px"
  },
  {
   "features": [
    {
     "geometry": {
      "coordinates": [
       [
        [
         1.0,
         1.0
        ],
        [
         2.0,
         2.0
        ]
       ]
      ],
      "type": "MultiLineString"
     },
     "properties": {
      "id": "s1.00_398.00_2.00_399.00",
      "layer": "text",
      "reason": "small"
     },
     "type": "Feature"
    }
   ],
   "frame": "drawing",
   "type": "FeatureCollection",
   "unit": "px"
  }
 ],
 "walls": [
  {
   "features": [
    {
     "geometry": {
      "coordinates": [
       [
        0.0,
        0.0
       ],
       [
        4.0,
        0.0
       ],
       [
        4.0,
        3.0
       ]
      ],
      "type": "LineString"
     },
     "properties": {
      "confidence": 1.0,
      "faces": [
       [
        [
         0.0,
         0.1
        ],
        [
         3.9,
         0.1
        ],
        [
         3.9,
         3.0
        ]
       ],
       [
        [
         0.0,
         -0.1
        ],
        [
         4.1,
         -0.1
        ],
        [
         4.1,
         3.0
        ]
       ]
      ],
      "kind": "wall",
      "layer": "wall",
      "reason": "two faces, or one filled bar, as far apart as a wall is thick",
      "thickness_m": 0.2
     },
     "type": "Feature"
    },
    {
     "geometry": {
      "coordinates": [
       [
        [
         1.0,
         1.0
        ],
        [
         1.4,
         1.0
        ],
        [
         1.4,
         1.4
        ],
        [
         1.0,
         1.4
        ],
        [
         1.0,
         1.0
        ]
       ]
      ],
      "type": "Polygon"
     },
     "properties": {
      "kind": "column",
      "layer": "column",
      "reason": "a solid outline that is too short for a wall"
     },
     "type": "Feature"
    }
   ],
   "frame": "map",
   "type": "FeatureCollection",
   "unit": "m"
  }
 ]
};
