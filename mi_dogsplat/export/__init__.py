"""Models in the formats of other programs: SPZ, SOG, compressed PLY, glTF, OpenUSD, plain PLY; and what they lose."""
