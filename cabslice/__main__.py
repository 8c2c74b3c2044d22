"""python -m cabslice"""

from cabslice.cli.main import run

run()
