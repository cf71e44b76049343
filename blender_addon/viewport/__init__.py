"""What viewports show while they move, and from where: a share of the splats, quads and colours made for the view."""
