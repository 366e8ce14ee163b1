"""The bundled faces, by name."""

from pathlib import Path

DATA = Path(__file__).parent.parent / "examples"
ICT_NEUTRAL = DATA / "ict_face" / "A_neutral.ply"
ICT_SMILE = DATA / "ict_face" / "A_smile.ply"
ICT_JAW_OPEN = DATA / "ict_face" / "A_jaw_open.ply"
HEAD_NEUTRAL = DATA / "makehuman" / "female_cauc_head_neutral.obj"
HEAD_SMILE = DATA / "makehuman" / "female_cauc_head_smile.obj"
HEAD_MOUTH_OPEN = DATA / "makehuman" / "female_cauc_head_mouth_open.obj"
