"""What answers of other processes have to look like before anything is made of them.

A shape is int (a count that fits into 64 bits), str, bool, [shape] for a list, [shape, n] for one of n at most,
{str: shape} for a table with any names, or a dictionary of names and shapes, where names that end in '?' may be
missing. Other members are left out.
"""

MOST = 2 ** 64 - 1


class Misshapen(ValueError):
    """A value is not of its shape; the text says where."""


def fit(value, shape, where='the answer'):
    """`value` as a copy that holds what `shape` names and nothing else. @raise Misshapen"""
    if shape is str:
        expect(isinstance(value, str), where, value, 'a text')
        return ''.join(c if c.isprintable() else '?' for c in value)  # peers may give themselves names for terminals
    if shape is bool:
        expect(isinstance(value, bool), where, value, 'true or false')
        return value
    if shape is int:
        expect(isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= MOST, where, value, 'a count')
        return value
    if isinstance(shape, list):
        expect(isinstance(value, list), where, value, 'a list')
        expect(len(value) <= (shape[1:] or [len(value)])[0], where, value, 'a list of %s at most' % shape[-1])
        return [fit(one, shape[0], '%s[%d]' % (where, i)) for i, one in enumerate(value)]
    expect(isinstance(value, dict), where, value, 'an object')
    if str in shape:
        return {fit(name, str, where): fit(one, shape[str], where) for name, one in value.items()}
    found = {}
    for name, of_member in shape.items():
        key = name.rstrip('?')
        expect(key in value or name != key, where, value, 'an object with %s' % key)
        if key in value:
            found[key] = fit(value[key], of_member, '%s.%s' % (where, key))
    return found


def expect(holds, where, value, what):
    if not holds:
        raise Misshapen('%s is %s, must be %s' % (where, ascii(value)[:60], what))
