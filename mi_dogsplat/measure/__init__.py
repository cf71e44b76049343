"""How far a picture is from its photograph, and how long things take."""
