"""What sets up, builds, and makes the pictures and models of this repository; most of it is behind a target of make."""
