"""Calibrated pairs: cameras and rigs, epipolar rectification, disparity. Pose, cloud and reconstruct share it."""
