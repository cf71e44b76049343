"""Scans by apps of phones with LiDAR: photographs with poses by ARKit and depth maps, as each app exports them."""
