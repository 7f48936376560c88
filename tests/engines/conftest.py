from engines.stand_ins import temporary

__all__ = ["temporary"]
