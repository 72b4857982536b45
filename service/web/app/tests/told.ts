/** What the service tells; `poe told` writes it anew. */
import type { Told } from "./types";

export const told: Told = {
 "candidates": [
  {
   "T_map_scan": [
    [
     1.0,
     0.0,
     0.0,
     0.0
    ],
    [
     0.0,
     1.0,
     0.0,
     0.0
    ],
    [
     0.0,
     0.0,
     1.0,
     0.0
    ],
    [
     0.0,
     0.0,
     0.0,
     1.0
    ]
   ],
   "inlier_share": 0.8,
   "inlier_share_of_structure": 0.9,
   "starts": 3
  }
 ],
 "differences": [
  {
   "points_added": 2,
   "points_removed": 1,
   "tile_size_m": 20,
   "tiles": [
    {
     "change": "changed",
     "corner_m": [
      0.0,
      0.0
     ],
     "points_added": 2,
     "points_kept": 0,
     "points_removed": 1
    }
   ],
   "tiles_unchanged": 0
  }
 ],
 "erased": [
  {
   "drawing": true,
   "layers": {},
   "region": {
    "within": [
     [
      0.0,
      0.0
     ],
     [
      1.0,
      0.0
     ],
     [
      1.0,
      1.0
     ]
    ],
    "z_min_m": 0.5
   },
   "region_id": "reg_1"
  }
 ],
 "evidence": [
  {
   "astray_share": 0.0,
   "closed_directions": 1,
   "contradicted_share": 0.0,
   "converged": true,
   "covariance": [
    [
     0.0001,
     0.0,
     0.0,
     0.0,
     0.0,
     0.0
    ],
    [
     0.0001,
     0.0,
     0.0,
     0.0,
     0.0,
     0.0
    ],
    [
     0.0001,
     0.0,
     0.0,
     0.0,
     0.0,
     0.0
    ],
    [
     0.0001,
     0.0,
     0.0,
     0.0,
     0.0,
     0.0
    ],
    [
     0.0001,
     0.0,
     0.0,
     0.0,
     0.0,
     0.0
    ],
    [
     0.0001,
     0.0,
     0.0,
     0.0,
     0.0,
     0.0
    ]
   ],
   "euclidean_fitness_score_m2": 0.02,
   "explained_share_at_top": 0.9,
   "information_eigenvalues": [
    0.08,
    0.1,
    0.1,
    0.2,
    0.2,
    0.3
   ],
   "inlier_distance_m": 0.1,
   "inlier_share": 0.9,
   "inlier_share_of_structure": 0.95,
   "iterations": 80,
   "map_kind": "faces",
   "mirrored_contradicted_share": null,
   "mirrored_inlier_share": null,
   "moved_m": 0.5,
   "ndt_resolution_m": 1.0,
   "nearest_voxel_transformation_likelihood": 1.7,
   "overlap_share": 0.99,
   "points_compared": 6000,
   "poses_compared": 0,
   "position_sensitivity_m": 0.022,
   "position_std_m": 0.01,
   "residual_median_m": 0.006,
   "residual_rms_m": 0.02,
   "runner_up_contradicted_share": null,
   "runner_up_distance_m": null,
   "runner_up_inlier_share": null,
   "runner_up_turn_rad": null,
   "slide_gain": null,
   "slide_m": null,
   "starts": 7,
   "starts_agreeing": 7,
   "tilt_rad": 0.002,
   "transformation_probability": 1.9,
   "turned_rad": 0.14,
   "undrawn_wall_share": 0.05,
   "upright_surfaces": 5,
   "weak_directions": [],
   "yaw_sensitivity_rad": 0.005,
   "yaw_std_rad": 0.002
  },
  {
   "astray_share": 0.0,
   "closed_directions": 1,
   "contradicted_share": 0.0,
   "converged": true,
   "covariance": [
    [
     null,
     null,
     null,
     null,
     null,
     null
    ],
    [
     null,
     null,
     null,
     null,
     null,
     null
    ],
    [
     null,
     null,
     null,
     null,
     null,
     null
    ],
    [
     null,
     null,
     null,
     null,
     null,
     null
    ],
    [
     null,
     null,
     null,
     null,
     null,
     null
    ],
    [
     null,
     null,
     null,
     null,
     null,
     null
    ]
   ],
   "euclidean_fitness_score_m2": 0.02,
   "explained_share_at_top": 0.9,
   "information_eigenvalues": [
    0.08,
    0.1,
    0.1,
    0.2,
    0.2,
    0.3
   ],
   "inlier_distance_m": 0.1,
   "inlier_share": 0.9,
   "inlier_share_of_structure": 0.95,
   "iterations": 80,
   "map_kind": "faces",
   "mirrored_contradicted_share": null,
   "mirrored_inlier_share": null,
   "moved_m": 0.5,
   "ndt_resolution_m": 1.0,
   "nearest_voxel_transformation_likelihood": 1.7,
   "overlap_share": 0.99,
   "points_compared": 6000,
   "poses_compared": 0,
   "position_sensitivity_m": 0.022,
   "position_std_m": 0.01,
   "residual_median_m": 0.006,
   "residual_rms_m": 0.02,
   "runner_up_contradicted_share": null,
   "runner_up_distance_m": null,
   "runner_up_inlier_share": null,
   "runner_up_turn_rad": null,
   "slide_gain": null,
   "slide_m": null,
   "starts": 7,
   "starts_agreeing": 7,
   "tilt_rad": 0.002,
   "transformation_probability": 1.9,
   "turned_rad": 0.14,
   "undrawn_wall_share": 0.05,
   "upright_surfaces": 5,
   "weak_directions": [],
   "yaw_sensitivity_rad": 0.005,
   "yaw_std_rad": 0.002
  }
 ],
 "gone": [
  {
   "layer_id": "lay_1",
   "name": "machine",
   "things": [
    {
     "looked_through": 8,
     "points": 9,
     "region": {
      "within": [
       [
        0.0,
        0.0
       ],
       [
        1.0,
        0.0
       ],
       [
        1.0,
        1.0
       ]
      ],
      "z_min_m": 0.5
     },
     "still_seen": 1
    }
   ],
   "whole_layer": false
  }
 ],
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
 "readings": [
  {
   "confidence": 1.0,
   "counts": {
    "columns": 1,
    "removed": {
     "text": 1
    },
    "removed_strokes": {
     "text": 1
    },
    "wall_length_m": 7.0,
    "walls": 1
   },
   "drawing_origin": [
    0.0,
    0.0
   ],
   "drawing_top": null,
   "findings": [],
   "frame": "drawing",
   "layers": [],
   "scale": {
    "candidates": [],
    "metres_per_unit": 0.01,
    "state": "given",
    "witnesses": []
   },
   "sheet": [
    5.0,
    4.0
   ],
   "style": "outlined",
   "unit": "m"
  },
  {
   "confidence": 1.0,
   "counts": {
    "columns": 1,
    "removed": {
     "text": 1
    },
    "removed_strokes": {
     "text": 1
    },
    "wall_length_px": 7.0,
    "walls": 1
   },
   "drawing_origin": [
    0.0,
    0.0
   ],
   "drawing_top": 400.0,
   "findings": [
    {
     "code": "scale-unknown",
     "message": "No two witnesses agree.",
     "severity": "warning"
    }
   ],
   "frame": "drawing",
   "layers": [],
   "scale": {
    "candidates": [
     {
      "metres_per_unit": 0.01,
      "witnesses": [
       "title-block"
      ]
     },
     {
      "metres_per_unit": 0.03,
      "witnesses": [
       "wall"
      ]
     }
    ],
    "metres_per_unit": null,
    "state": "unknown",
    "witnesses": [
     {
      "count": 1,
      "detail": "1:100",
      "kind": "title-block",
      "metres_per_unit": 0.01
     },
     {
      "count": 9,
      "detail": "usual",
      "kind": "wall",
      "metres_per_unit": [
       0.02,
       0.05
      ]
     }
    ]
   },
   "sheet": [
    500.0,
    400.0
   ],
   "style": "outlined",
   "unit": "px"
  }
 ],
 "roughPoses": [
  {
   "x_m": 1.0,
   "y_m": 2.0,
   "yaw_rad": 0.0,
   "z_m": 0.0
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
