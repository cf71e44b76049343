"""Triangles from splats: depth pictures of a model are fused to a signed distance, whose zeros are its surface."""
