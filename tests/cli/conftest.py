from .fakes import elsewhere as elsewhere
from .fakes import engine as engine
