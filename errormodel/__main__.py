"""``python -m errormodel``: the command line, where the folder of installed scripts is not on the path."""

from identification.command_line.start import entry

if __name__ == "__main__":
    entry()
