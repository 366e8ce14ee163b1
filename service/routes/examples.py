"""Examples of edit documents, as the OpenAPI document shows them."""

from __future__ import annotations

from typing import Any

EDIT: dict[str, Any] = {
    "source": "msh_a",
    "targets": [{"mesh": "msh_b", "name": "smile"}, {"mesh": "msh_c", "name": "jaw_open"}],
    "control_points": {
        "points": [
            {
                "name": "mouth_left",
                "at": {"vertex": 4172},
                "to": {"smile": {"position": [1.9, -3.2, 9.1]}},
                "weights": {"smile": 1.0, "jaw_open": 0.2},
            },
            {
                "name": "nose_tip",
                "at": {"position": [0, 1.2, 13.0], "max_snap": 0.5},
                "fixed": True,
            },
            {
                "name": "brow_right",
                "at": {"polygon": 991, "barycentric": [0.2, 0.3, 0.5]},
                "move": [0, 0.4, 0.1],
            },
        ],
        "auto": 68,
    },
    "weights": {"smile": 0.7},
    "frames": 12,
    "output": {"formats": ["source", "glb"], "histogram_bins": 50},
    "options": {},
}
FORM_EDIT: dict[str, Any] = {
    "edit": {
        "source": "neutral.ply",
        "targets": [{"mesh": "smile.ply", "name": "smile"}],
        "weights": {"smile": 0.7},
    }
}
