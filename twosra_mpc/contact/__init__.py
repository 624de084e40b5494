"""Robot and object in contact: shapes that touch, cages that hold, motions that push."""
