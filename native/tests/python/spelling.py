"""What isn't American spelling; Blender's own texts are in it, and so are this project's."""

import re

WORDS = r"""
    \w*(?:behavi|col|endeav|fav|flav|hon|lab|neighb|rum|vap)our\w*  \w*cent(?:re|res|red|ring)
    \w*(?:met|fib|lit|calib|theat)res?  (?:grey|mould|plough|sceptic|artefact|focuss)\w*
    \w*(?:cancel|label|level|model|signal|travel|tunnel)l(?:ed|er|ers|ing)s?
    (?:after|back|down|for|in|on|out|side|to|up)wards  (?:ana|para|cata)lys(?:ed?|er|ing)
    (?:de|of|pre)fence\w*  licences?  programmes?  whilst  amongst  learnt  spelt  ageing  judgement
    anti-?clockwise  catalogues?  practise\w*  fulfil  skilful\w*  maths
"""
BRITISH = re.compile(rf"\b(?:{'|'.join(WORDS.split())})\b")
# What takes -ize in American English, except for these, and for what ends in -wise.
ISE = re.compile(r"\b([a-z]{2,}?)is(?:e[ds]?|ers?|ing|ations?)\b")
AMERICAN_ISE = """
    advert adv appra appr ar bra bru chast chem compr comprom conc cru dem deno desp dev disgu
    enterpr exc exerc expert franch gu improv inc merchand no parad po pra prec prem prom ra repr
    rev superv surm surpr telev treat turquo v
"""


def british(text: str) -> list[str]:
    """The British spellings in a text."""
    text = text.lower()
    found = [match[0] for match in BRITISH.finditer(text)]
    for match in ISE.finditer(text):
        if match[1] not in AMERICAN_ISE.split() and not match[1].endswith("w"):
            found.append(match[0])
    return found
