"""Motions between processing motions: retraction, free motion, approach (RFA paper, section II), and which to take."""
