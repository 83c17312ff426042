"""Error motions that drift with temperature: from recordings over thermal cycles to effects of the machine."""
