"""Primitives along arbitrary rays: transmittance and blended colour, without images, tiles or cameras."""
