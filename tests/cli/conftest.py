from .fakes import engine as engine
