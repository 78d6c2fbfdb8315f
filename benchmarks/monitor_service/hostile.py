def add_options(p):
    pass


def run(g):
    return {}
